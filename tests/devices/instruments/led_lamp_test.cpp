// The lamp on a spare analog output: its contract over the USB-3103's driver and emulator, its
// limits, bad days.
// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/lamp.h"
#include "devices/instruments/led_lamp/driver.h"
#include "devices/instruments/usb3103/driver.h"
#include "devices/instruments/usb3103/emulator.h"

#include <gtest/gtest.h>

#include <stdexcept>

namespace vitreo::led_lamp {
namespace VITREO_TEST_FILE {

struct LedLamp : ::testing::Test {
  std::unique_ptr<CoilAmplifier> outputs() {
    usb3103::Settings unit;
    unit.name = "lamp";
    unit.amperes_per_volt = 0.1;
    unit.current_limit = 0.5;
    return usb3103::open(memory_hid_link(*emulator, *clock, Time(0)), unit, *clock);
  }
  double light() const { return emulator->outputs()[2] * 0.1 / settings.full_current; }

  std::unique_ptr<Clock> clock = virtual_clock();
  std::unique_ptr<usb3103::Emulator> emulator = usb3103::make_emulator({}, nullptr);
  Settings settings{.output = 2, .full_current = 0.4};
};

TEST_F(LedLamp, KeepsTheContractOfALamp) {
  const auto lamp = open(outputs(), settings);
  contract::LampCheck how;
  how.measured = [this] { return light(); };
  EXPECT_EQ(contract::check(*lamp, how), std::vector<std::string>{});
  EXPECT_NE(lamp->identity().find("output 2 of Measurement Computing"), std::string::npos);
}

TEST_F(LedLamp, LeavesAllOtherOutputsAtZeroAndIsDarkWhenItGoes) {
  auto lamp = open(outputs(), settings);
  lamp->set_level(1);
  for (std::size_t i = 0; i < usb3103::kChannels; ++i)
    EXPECT_NEAR(emulator->outputs()[i], i == 2 ? 4 : 0, 1e-3);
  lamp.reset();
  EXPECT_EQ(emulator->outputs(), usb3103::Voltages{});
}

TEST_F(LedLamp, DarkensWhatAHostThatDiedLeftBurning) {
  {
    const auto link = memory_hid_link(*emulator, *clock, Time(0));
    link->write(usb3103::encode(usb3103::AnalogOutConfig{2, usb3103::Range::plus_minus_10_v}));
    link->write(usb3103::encode(usb3103::AnalogOut{2, 0xC000, false}));
  }
  ASSERT_GT(light(), 0.5);
  const auto lamp = open(outputs(), settings);
  EXPECT_EQ(light(), 0);
}

TEST_F(LedLamp, ThrowsForSettingsThatDoNotFit) {
  const auto bad = [&](Settings wrong) {
    EXPECT_THROW(open(outputs(), wrong), std::invalid_argument);
  };
  bad({.name = ""});
  bad({.output = -1});
  bad({.output = 8});
  bad({.full_current = 0});
  bad({.full_current = 0.6});  // the unit was told to give half an ampere
  EXPECT_THROW(open(nullptr, settings), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::led_lamp
