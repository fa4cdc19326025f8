// SpaceMouse and foot pedals as a rig file describes them.
// SPDX-License-Identifier: Apache-2.0
#include "devices/foot_pedal/driver.h"
#include "devices/foot_pedal/emulator.h"
#include "devices/spacemouse/driver.h"
#include "devices/spacemouse/emulator.h"
#include "host/drivers/drivers.h"

namespace vitreo {

Opener<OperatorInput> read_spacemouse(const InstrumentReader& instrument) {
  ConfigReader& reader = instrument.reader;
  spacemouse::Settings settings;
  settings.name = instrument.role;
  settings.dead_zone = reader.number("dead_zone", settings.dead_zone, {0, 0.5, ""});
  settings.watchdog = reader.number("watchdog", settings.watchdog, {0.02, 10, "s"});
  if (instrument.emulated())
    return [settings](const Surroundings& where) {
      auto nobody = std::make_shared<spacemouse::Emulator>();  // a handle that nobody touches
      auto link = memory_hid_link(*nobody, where.clock, Time(0));
      return Opened<OperatorInput>{nobody, spacemouse::open(std::move(link), settings, where.clock)};
    };
  return [settings, address = read_usb_address(instrument, "hid")](const Surroundings& where) {
    return Opened<OperatorInput>{nullptr, spacemouse::open(open_hid_link(address, where.clock), settings, where.clock)};
  };
}

Opener<OperatorInput> read_foot_pedal(const InstrumentReader& instrument) {
  foot_pedal::Settings settings;
  settings.name = instrument.role;
  if (instrument.reader.choice("layout", "xkeys_xk3", {"xkeys_xk3", "infinity"}) == "infinity")
    settings.layout = foot_pedal::infinity();
  if (instrument.emulated())
    return [settings](const Surroundings& where) {
      auto nobody = std::make_shared<foot_pedal::Emulator>(settings.layout);  // a pedal that nobody stands on
      auto link = memory_hid_link(*nobody, where.clock, Time(0));
      return Opened<OperatorInput>{nobody, foot_pedal::open(std::move(link), settings)};
    };
  return [settings, address = read_usb_address(instrument, "hid")](const Surroundings& where) {
    return Opened<OperatorInput>{nullptr, foot_pedal::open(open_hid_link(address, where.clock), settings)};
  };
}

}  // namespace vitreo
