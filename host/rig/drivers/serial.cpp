// SPDX-License-Identifier: Apache-2.0
#include "host/rig/drivers/serial.h"

#include <stdexcept>

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
  if (bus == "serial") {
    place.serial.data_bits = instrument.reader.integer("data_bits", usual.data_bits, 7, 8);
    const std::string parity = instrument.reader.choice("parity",
                                                        usual.parity == Parity::odd    ? "odd"
                                                        : usual.parity == Parity::even ? "even"
                                                                                       : "none",
                                                        {"none", "odd", "even"});
    place.serial.parity = parity == "odd"    ? Parity::odd
                          : parity == "even" ? Parity::even
                                             : Parity::none;
  }
  return place;
}

}  // namespace vitreo
