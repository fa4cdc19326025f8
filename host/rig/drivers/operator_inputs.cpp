// SpaceMouse and foot pedals as a rig file describes them.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/foot_pedal/driver.h"
#include "devices/instruments/foot_pedal/emulator.h"
#include "devices/instruments/game_pad/driver.h"
#include "devices/instruments/game_pad/emulator.h"
#include "devices/instruments/spacemouse/driver.h"
#include "devices/instruments/spacemouse/emulator.h"
#include "devices/links/address.h"
#include "devices/links/event_link.h"
#include "devices/links/usb_frames.h"
#include "host/rig/drivers/drivers.h"
#include "host/rig/drivers/reopened.h"
#include "host/rig/drivers/serial.h"
#include "host/rig/drivers/traced.h"

#include <algorithm>
#include <cmath>

namespace vitreo {
namespace {

/// What is done to an emulated SpaceMouse: nothing, or a push, once or again and again.
/// For trials of what a hand does, at times that are the same in every run of a seed.
struct Push {
  Eigen::Vector3d deflection{0, 0, 0};  // of full
  double from = 0;                      // s
  double lasting = 0;                   // s
  double every = 0;                     // s from one to the next; 0: there is one only
};

/// The driver on an emulator that a task pushes; the task is ended first.
class Pushed final : public OperatorInput {
 public:
  Pushed(const spacemouse::Settings& settings, const RigContext& where, const Push& push)
      : mouse_(spacemouse::open(traced(where, settings.name, "emulated",
                                       memory_hid_link(emulator_, where.clock, kUsbFrame)),
                                settings, where.clock)) {
    // The task's name decides its turn among tasks that are due at the same time.
    if (push.lasting > 0)
      hand_ = where.clock.spawn("hand", [this, &clock = where.clock, push] { act(clock, push); });
  }
  std::string identity() const override { return mouse_->identity(); }
  OperatorState state() override { return mouse_->state(); }

 private:
  // Reports come as long as the handle is deflected, and one of zeros at the end: without them the
  // driver's watchdog would take the push for over.
  void act(Clock& clock, const Push& push) {
    constexpr Time kReport = std::chrono::milliseconds(16);  // as often as the device reports
    const auto counts = [&push](int axis) {
      return static_cast<std::int16_t>(
          std::lround(push.deflection[axis] * spacemouse::kFullScale_counts));
    };
    const auto other = [&](int axis) { return static_cast<std::int16_t>(-counts(axis)); };
    Time next = from_seconds(push.from);
    do {
      clock.sleep_until(next);
      for (const Time end = next + from_seconds(push.lasting); clock.now() < end;
           clock.sleep_for(kReport))
        // y and z of the device point the other way.
        emulator_.deflect({counts(0), other(1), other(2)}, {});
      emulator_.deflect({}, {});
      next += from_seconds(push.every);
    } while (push.every > 0);
  }

  spacemouse::Emulator emulator_;
  const std::unique_ptr<OperatorInput> mouse_;
  std::unique_ptr<Task> hand_;
};

Push read_push(ConfigReader& reader) {
  Push push;
  push.deflection = reader.vector3("pushed", push.deflection, {-1, 1, ""});
  push.from = reader.number("pushed_from", 0, {0, 1e5, "s"});
  push.lasting = reader.number("pushed_for", 0, {0, 1e5, "s"});
  push.every = reader.number("pushed_every", 0, {0, 1e5, "s"});
  if (push.every > 0 && push.every <= push.lasting)
    reader.fail("pushed_every", "is not longer than pushed_for");
  return push;
}

}  // namespace

// An emulated one is not reopened: it has no cable to be pulled.
Opener<OperatorInput> read_spacemouse(const InstrumentReader& instrument) {
  ConfigReader& reader = instrument.reader;
  spacemouse::Settings settings;
  settings.name = instrument.role;
  settings.dead_zone = reader.number("dead_zone", settings.dead_zone, {0, 0.5, ""});
  settings.watchdog = reader.number("watchdog", settings.watchdog, {0.02, 10, "s"});
  if (instrument.emulated())
    return [settings, push = read_push(reader)](const RigContext& where) {
      return Opened<OperatorInput>{nullptr, std::make_unique<Pushed>(settings, where, push)};
    };
  const auto open = [settings,
                     address = read_usb_address(instrument, "hid")](const RigContext& where) {
    return spacemouse::open(traced(where, settings.name, to_string("hid", address),
                                   open_hid_link(address, where.clock)),
                            settings, where.clock);
  };
  return reopened<OperatorInput>(instrument.role, open);
}

Opener<OperatorInput> read_foot_pedal(const InstrumentReader& instrument) {
  foot_pedal::Settings settings;
  settings.name = instrument.role;
  // The makers' products differ; the address says which it is.
  const std::string usual = instrument.address.rfind("hid:05f3:04", 0) == 0     ? "xkeys_xk3_0438"
                            : instrument.address.rfind("hid:05f3:00ff", 0) == 0 ? "infinity"
                                                                                : "xkeys_xk3";
  const std::string layout =
      instrument.reader.choice("layout", usual, {"xkeys_xk3", "xkeys_xk3_0438", "infinity"});
  if (layout == "infinity") settings.layout = foot_pedal::infinity();
  if (layout == "xkeys_xk3_0438") settings.layout = foot_pedal::xkeys_xk3_0438();
  if (instrument.emulated())
    return [settings](const RigContext& where) {
      // Never pressed.
      auto released = std::make_shared<foot_pedal::Emulator>(settings.layout);
      auto link = traced(where, settings.name, "emulated",
                         memory_hid_link(*released, where.clock, kUsbFrame));
      return Opened<OperatorInput>{released, foot_pedal::open(std::move(link), settings)};
    };
  const auto open = [settings,
                     address = read_usb_address(instrument, "hid")](const RigContext& where) {
    return foot_pedal::open(traced(where, settings.name, to_string("hid", address),
                                   open_hid_link(address, where.clock)),
                            settings);
  };
  return reopened<OperatorInput>(instrument.role, open);
}

// Six names of axes and any number of buttons; what a pad has, an error at its opening says.
Opener<OperatorInput> read_game_pad(const InstrumentReader& instrument) {
  ConfigReader& reader = instrument.reader;
  game_pad::Settings settings;
  settings.name = instrument.role;
  settings.dead_zone = reader.number("dead_zone", settings.dead_zone, {0.01, 0.5, ""});
  if (reader.has("axes")) {
    const std::vector<std::string> axes = reader.texts("axes");
    if (axes.size() != settings.axes.size())
      reader.fail("axes", "must be six names, \"\" for none: x, y, z, about x, about y, about z");
    std::copy(axes.begin(), axes.end(), settings.axes.begin());
  }
  if (reader.has("buttons")) settings.buttons = reader.texts("buttons");
  check_settings(instrument, settings);
  if (instrument.emulated())
    return [settings](const RigContext& where) {
      auto at_rest = std::make_shared<game_pad::Emulator>();
      return Opened<OperatorInput>{at_rest,
                                   game_pad::open(traced(where, settings.name, "emulated",
                                                         memory_event_link(*at_rest, where.clock)),
                                                  settings)};
    };
  const Address address = parse_address(instrument.address);
  if (address.bus != "evdev") reader.fail("address", "must be \"evdev:NODE\" or \"evdev:VID:PID\"");
  const auto open = [settings, place = address.place](const RigContext& where) {
    return game_pad::open(
        traced(where, settings.name, "evdev:" + place, open_evdev(place, where.clock)), settings);
  };
  return reopened<OperatorInput>(instrument.role, open);
}

}  // namespace vitreo
