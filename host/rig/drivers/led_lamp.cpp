// A dimmed LED as a rig file describes it: { driver = "led", address = "hid:09db:009c:SERIAL",
// output = 0 }.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/led_lamp/driver.h"
#include "devices/instruments/usb3103/driver.h"
#include "devices/instruments/usb3103/emulator.h"
#include "devices/instruments/usb3103/timing.h"
#include "host/rig/drivers/drivers.h"
#include "host/rig/drivers/reopened.h"
#include "host/rig/drivers/serial.h"
#include "host/rig/drivers/traced.h"
#include "host/rig/drivers/usb.h"

namespace vitreo {

// An LED on an analog output of a USB-3103 of its own. The current limit of the outputs is the
// lamp's full current: level 1 is the most that the device gives at all.
Opener<Lamp> read_led_lamp(const InstrumentReader& instrument) {
  ConfigReader& reader = instrument.reader;
  usb3103::Settings outputs;
  outputs.name = instrument.role;
  outputs.amperes_per_volt = reader.number("amperes_per_volt", 0.1, {1e-3, 10, ""});
  outputs.reply_timeout = reader.number("reply_timeout", outputs.reply_timeout, {1e-3, 5, "s"});
  if (reader.has("enable_line")) outputs.enable_line = reader.integer("enable_line", 0, 0, 7);
  outputs.heartbeat = outputs.enable_line && reader.has("heartbeat");
  led_lamp::Settings lamp;
  lamp.name = instrument.role;
  lamp.output = reader.integer("output", lamp.output, 0, usb3103::kChannels - 1);
  lamp.full_current = reader.number("full_current", lamp.full_current, {1e-3, 10, "A"});
  outputs.current_limit = lamp.full_current;
  const double interval = read_transfer_interval(instrument);
  instrument.links.loads.push_back(
      {instrument.role, "a level", usb3103::update_time(interval), false, 0});
  check_settings(instrument, outputs);
  const auto open = [outputs, lamp](std::unique_ptr<HidLink> link, Clock& clock) {
    return led_lamp::open(usb3103::open(std::move(link), outputs, clock), lamp);
  };
  if (!instrument.emulated())
    return reopened<Lamp>(instrument.role, [open, address = read_usb_address(instrument, "hid")](
                                               const RigContext& where) {
      return open(
          traced(where, "lamp", to_string("hid", address), open_hid_link(address, where.clock)),
          where.clock);
    });
  return [open, outputs, lamp, frame = from_seconds(interval)](const RigContext& where) {
    // The light in the simulated eye is what the output puts out.
    std::shared_ptr<usb3103::Emulator> unit = usb3103::make_emulator(
        {}, [laboratory = where.laboratory, outputs, lamp](const usb3103::Voltages& volts) {
          const double current =
              volts[static_cast<std::size_t>(lamp.output)] * outputs.amperes_per_volt;
          if (laboratory != nullptr) laboratory->set_light(current / lamp.full_current);
        });
    // This rig has its light from the lamp alone, which is dark at first.
    if (where.laboratory != nullptr) where.laboratory->set_light(0);
    auto link = traced(where, "lamp", "emulated", memory_hid_link(*unit, where.clock, frame));
    return Opened<Lamp>{unit, open(std::move(link), where.clock)};
  };
}

}  // namespace vitreo
