// SPDX-License-Identifier: Apache-2.0
#include "host/rig/drivers/serial.h"

#include <algorithm>
#include <stdexcept>
#include <vector>

namespace vitreo {
namespace {

/// Of a list of addresses, which the role's reader has seen as a whole only.
std::string bus_of(const InstrumentReader& instrument) {
  try {
    return parse_address(instrument.address).bus;
  } catch (const std::invalid_argument& problem) {
    instrument.reader.fail("address", problem.what());
  }
}

/// One of an enumeration whose names are in its order.
template <class Enum>
void read_enum(ConfigReader& reader, const std::string& key, const std::vector<std::string>& names,
               Enum& value) {
  const std::string chosen = reader.choice(key, names[static_cast<std::size_t>(value)], names);
  value = static_cast<Enum>(std::find(names.begin(), names.end(), chosen) - names.begin());
}

/// What the line has beside its rate.
void read_line(ConfigReader& reader, SerialSettings& line) {
  line.data_bits = reader.integer("data_bits", line.data_bits, 5, 8);
  line.stop_bits = reader.integer("stop_bits", line.stop_bits, 1, 2);
  read_enum(reader, "parity", parity_names(), line.parity);
  read_enum(reader, "opening_lines", opening_lines_names(), line.opening_lines);
  const char* const usual = line.rts_cts ? "rts_cts" : line.xon_xoff ? "xon_xoff" : "none";
  set_flow(line, reader.choice("flow", usual, flow_names()));
}

}  // namespace

SerialPlace read_serial_place(const InstrumentReader& instrument, const SerialSettings& usual) {
  SerialPlace place{instrument.address, usual};
  const std::string bus = bus_of(instrument);
  if (bus != "serial" && bus != "tcp" && bus != "emulated")
    instrument.reader.fail("address", "must be \"serial:PATH\", \"tcp:HOST:PORT\" or \"emulated\"");
  place.ideal = bus == "tcp";
  if (place.ideal) return place;
  const int baud_rate = instrument.reader.integer("baud_rate", usual.baud_rate, 0, 4'000'000);
  place.ideal = baud_rate == 0 && place.emulated();
  if (!place.ideal && baud_rate < 300)
    instrument.reader.fail("baud_rate", "must be 300 or more (0: emulated, bytes take no time)");
  if (!place.ideal) place.serial.baud_rate = baud_rate;
  read_line(instrument.reader, place.serial);
  return place;
}

}  // namespace vitreo
