// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/operator_input.h"
#include "devices/instruments/game_pad/driver.h"
#include "devices/instruments/game_pad/emulator.h"
#include "devices/time/error.h"

#include <gtest/gtest.h>

namespace vitreo {
namespace VITREO_TEST_FILE {

struct Pad {
  explicit Pad(const game_pad::Settings& settings = {})
      : input(game_pad::open(memory_event_link(emulator, *clock, &faults), settings)) {}
  void move(std::size_t axis, int counts) {
    emulator.move(axis, counts, clock->now());
    clock->sleep_for(std::chrono::milliseconds(100));
  }
  std::unique_ptr<Clock> clock = virtual_clock();
  game_pad::Emulator emulator;
  LinkFaults faults;
  std::unique_ptr<OperatorInput> input;
};

TEST(GamePad, KeepsItsContract) {
  Pad pad;
  EXPECT_EQ(contract::check(*pad.input, *pad.clock), std::vector<std::string>{});
}

TEST(GamePad, SticksDeflectWithinTheDeadZoneNothingAndAtTheEndAll) {
  Pad pad;
  EXPECT_EQ(pad.input->state().translation.norm(), 0);
  pad.move(0, 3000);  // 9 %
  EXPECT_EQ(pad.input->state().translation.x(), 0);
  pad.move(0, 32767);
  EXPECT_NEAR(pad.input->state().translation.x(), 1, 1e-9);
  pad.move(0, -32768);
  EXPECT_NEAR(pad.input->state().translation.x(), -1, 1e-9);
  pad.move(0, 0);
  pad.move(1, -32768);  // pushed away
  EXPECT_NEAR(pad.input->state().translation.y(), 1, 1e-9);
  pad.move(3, -32768);  // the right stick up
  EXPECT_NEAR(pad.input->state().translation.z(), 1, 1e-9);
  pad.move(0, 18022);  // half way from the dead zone's edge
  EXPECT_NEAR(pad.input->state().translation.x(), 0.5, 1e-3);
}

TEST(GamePad, ButtonsAreBitsInTheOrderOfTheSettings) {
  game_pad::Settings settings;
  settings.buttons = {"BTN_START", "BTN_SOUTH"};
  Pad pad(settings);
  pad.emulator.press(7, true, pad.clock->now());
  pad.clock->sleep_for(std::chrono::milliseconds(100));
  EXPECT_EQ(pad.input->state().pressed, 1U);
  pad.emulator.press(0, true, pad.clock->now());
  pad.emulator.press(7, false, pad.clock->now());
  pad.clock->sleep_for(std::chrono::milliseconds(100));
  EXPECT_EQ(pad.input->state().pressed, 2U);
}

TEST(GamePad, WhatIsDeflectedWhenItIsOpenedMovesNothingUntilItWasLetGo) {
  const auto clock = virtual_clock();
  game_pad::Emulator emulator;
  emulator.move(0, 32767, Time::zero());
  const auto input = game_pad::open(memory_event_link(emulator, *clock), {});
  EXPECT_EQ(input->state().translation.x(), 0) << "a book lies on it";
  emulator.move(0, 0, clock->now());
  clock->sleep_for(std::chrono::milliseconds(100));
  EXPECT_EQ(input->state().translation.x(), 0);
  emulator.move(0, 32767, clock->now());
  clock->sleep_for(std::chrono::milliseconds(100));
  EXPECT_NEAR(input->state().translation.x(), 1, 1e-9);
}

TEST(GamePad, WhatItHasNotIsNamedWithWhatItHas) {
  game_pad::Settings settings;
  settings.axes[0] = "ABS_WHEEL";
  try {
    const Pad pad(settings);
    ADD_FAILURE() << "no error";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.kind, DeviceErrorKind::not_found);
    EXPECT_NE(error.text.find("no axis ABS_WHEEL; it has ABS_X, ABS_Y"), std::string::npos)
        << error.text;
  }
  settings = {};
  settings.buttons = {"BTN_THUMB9"};
  EXPECT_THROW(Pad{settings}, DeviceError);
  settings = {};
  settings.dead_zone = 0;
  EXPECT_THROW(Pad{settings}, std::invalid_argument);
}

TEST(GamePad, OneThatIsUnpluggedIsLost) {
  Pad pad;
  pad.move(0, 0);
  pad.move(0, 32767);
  pad.faults.unplugged = true;
  try {
    pad.input->state();
    ADD_FAILURE() << "no error";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.kind, DeviceErrorKind::lost);
    EXPECT_EQ(error.device, "joystick");
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
