// rig.joystick, rig.pedal and rig.lamp as scripts have them, over their drivers and emulators.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/foot_pedal/driver.h"
#include "devices/instruments/foot_pedal/emulator.h"
#include "devices/instruments/led_lamp/driver.h"
#include "devices/instruments/spacemouse/driver.h"
#include "devices/instruments/spacemouse/emulator.h"
#include "devices/instruments/usb3103/driver.h"
#include "devices/instruments/usb3103/emulator.h"
#include "tests/host/lua/interpreter/lua_bench.h"

namespace vitreo {
namespace VITREO_TEST_FILE {

class OperatorBinding : public LuaBench {
 protected:
  OperatorBinding() {
    rig.joystick = mouse.get();
    rig.pedal = pedal.get();
    rig.lamp = lamp.get();
  }
  std::unique_ptr<CoilAmplifier> outputs() {
    usb3103::Settings settings;
    settings.name = "lamp";
    settings.amperes_per_volt = 0.1;
    settings.current_limit = 0.5;
    return usb3103::open(memory_hid_link(*unit, *clock, Time(0)), settings, *clock);
  }

  spacemouse::Emulator hand;
  foot_pedal::Emulator foot;
  std::unique_ptr<usb3103::Emulator> unit = usb3103::make_emulator({}, nullptr);
  std::unique_ptr<OperatorInput> mouse =
      spacemouse::open(memory_hid_link(hand, *clock, Time(0)), {}, *clock);
  std::unique_ptr<OperatorInput> pedal =
      foot_pedal::open(memory_hid_link(foot, *clock, Time(0)), {});
  std::unique_ptr<Lamp> lamp = led_lamp::open(outputs(), {.output = 3, .full_current = 0.5});
};

TEST_F(OperatorBinding, GivesTheJoysticksDeflectionsInOurAxes) {
  hand.deflect({350, 0, -350}, {0, 0, 175});
  hand.press(0b10);
  EXPECT_EQ(
      run("local now = rig.joystick:state()\n"
          "assert(now.translation.x == 1 and now.translation.y == 0 and now.translation.z == 1)\n"
          "assert(now.rotation.z < -0.4 and now.pressed[2] and not now.pressed[1])\n"
          "assert(rig.joystick:held(2) and not rig.joystick:held(1))\n"
          // silence: no operator deflects it
          "run:wait(0.2) assert(rig.joystick:state().translation.x == 0)")
          .error,
      "");
}

TEST_F(OperatorBinding, TellsWhetherAPedalIsHeld) {
  EXPECT_EQ(run("assert(not rig.pedal:held(1))").error, "");
  foot.press(0b100);
  EXPECT_EQ(run("assert(rig.pedal:held(3) and not rig.pedal:held(1))").error, "");
  EXPECT_NE(run("rig.pedal:held(0)").error.find("wants 1 to 32"), std::string::npos)
      << run("rig.pedal:held(0)").error;
}

TEST_F(OperatorBinding, DimsTheLamp) {
  EXPECT_EQ(
      run("assert(rig.lamp:level() == 0) rig.lamp:set_level(0.5) assert(rig.lamp:level() == 0.5)")
          .error,
      "");
  EXPECT_NEAR(unit->outputs()[3], 2.5, 1e-3);  // V: half of 0.5 A at 0.1 A/V
  EXPECT_EQ(unit->outputs()[2], 0);
  EXPECT_NE(run("rig.lamp:set_level(1.5)").error, "");
  EXPECT_NEAR(unit->outputs()[3], 2.5, 1e-3);
  lamp.reset();
  EXPECT_EQ(unit->outputs()[3], 0);
}

TEST_F(OperatorBinding, SteersByTheJoystickUntilTheDeadManIsReleased) {
  foot.press(1);
  const auto operators = clock->spawn("operator", [&] {
    for (int i = 0; i < 30; ++i) {
      hand.deflect({175, 0, 0}, {0, 0, 0});
      clock->sleep_for(std::chrono::milliseconds(20));
    }
    foot.press(0);
  });
  EXPECT_EQ(run("local x = 0\n"
                "while rig.pedal:held(1) do\n"
                "  x = x + rig.joystick:state().translation.x * 1e-3 * 0.02\n"
                "  run:wait(0.02)\n"
                "end\n"
                "assert(x > 0.25e-3 and x < 0.35e-3, x)")
                .error,
            "");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
