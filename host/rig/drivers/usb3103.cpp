// The USB-3103 as a rig file describes it.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/usb3103/driver.h"
#include "devices/instruments/usb3103/timing.h"
#include "devices/sim/faulty_links.h"
#include "host/rig/drivers/drivers.h"
#include "host/rig/drivers/reopened.h"
#include "host/rig/drivers/traced.h"
#include "host/rig/drivers/usb.h"

namespace vitreo {

// `amperes_per_volt` is the amplifier's behind the output; the laboratory is given the same, since
// the wire carries volts. An emulated unit is reopened too, so that faults of its link end as with
// a real one.
Opener<CoilAmplifier> read_usb3103(const InstrumentReader& instrument) {
  ConfigReader& reader = instrument.reader;
  usb3103::Settings settings;
  settings.name = instrument.role;
  settings.amperes_per_volt =
      reader.number("amperes_per_volt", settings.amperes_per_volt, {0.01, 100, ""});
  settings.current_limit = reader.number("current_limit", settings.current_limit, {0.1, 20, "A"});
  settings.reply_timeout = reader.number("reply_timeout", settings.reply_timeout, {1e-3, 5, "s"});
  if (reader.has("enable_line")) settings.enable_line = reader.integer("enable_line", 0, 0, 7);
  settings.heartbeat = settings.enable_line && reader.has("heartbeat");
  const double interval = read_transfer_interval(instrument);
  instrument.links.loads.push_back(
      {instrument.role, "a set point", usb3103::update_time(interval), true, 0});
  instrument.laboratory.amperes_per_volt = settings.amperes_per_volt;
  if (!instrument.emulated())
    return reopened<CoilAmplifier>(
        instrument.role,
        [settings, address = read_usb_address(instrument, "hid")](const RigContext& where) {
          return usb3103::open(traced(where, settings.name, to_string("hid", address),
                                      open_hid_link(address, where.clock)),
                               settings, where.clock);
        });
  return reopened<CoilAmplifier>(
      instrument.role, [settings, frame = from_seconds(interval)](const RigContext& where) {
        auto link = sim::faulty_hid_link(
            memory_hid_link(where.laboratory->coil_outputs(), where.clock, frame),
            where.laboratory->faults().links["coils"], where.clock);
        return usb3103::open(traced(where, settings.name, "emulated", std::move(link)), settings,
                             where.clock);
      });
}

}  // namespace vitreo
