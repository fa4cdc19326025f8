// The USB-3103's emulator: latches, sync, ranges, and what it makes of nonsense.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/usb3103/emulator.h"
#include "tests/devices/instruments/usb3103_test_bench.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <stdexcept>

namespace vitreo::usb3103 {
namespace VITREO_TEST_FILE {

constexpr double kHalf = 5;  // V: 0xC000 in the range +-10 V

struct Usb3103Emulator : ::testing::Test {
  Usb3103Emulator() {
    bench.receive(Report{0x43, 0});  // master
    for (std::uint8_t i = 0; i < kChannels; ++i) bench.receive(Report{0x1C, i, 1});
  }
  Bench bench;
};

TEST_F(Usb3103Emulator, KeepsALatchedValueUntilTheSync) {
  bench.receive(Report{0x14, 0, 0x00, 0xC0, 1});
  bench.receive(Report{0x14, 5, 0x00, 0x40, 1});
  EXPECT_EQ(bench.outputs(), Voltages{});
  bench.receive(Report{0x15});
  EXPECT_EQ(bench.outputs(), (Voltages{kHalf, 0, 0, 0, 0, -kHalf, 0, 0}));
  EXPECT_EQ(bench.steps.size(), 1U);
}

TEST_F(Usb3103Emulator, WithoutPowerItsOutputsFallAndItComesBackAsItWasAtFirst) {
  bench.receive(Report{0x14, 0, 0x00, 0xC0, 1});
  bench.receive(Report{0x15});
  bench.receive(Report{0x14, 1, 0x00, 0xC0, 1});
  bench.emulator->power_cycle();
  EXPECT_EQ(bench.outputs(), Voltages{});
  EXPECT_EQ(bench.steps.back(), Voltages{}) << "whoever listens is told";
  EXPECT_EQ(bench.receive(Report{0x44}), (std::vector<Report>{{0x44, 0}})) << "a slave again";
  bench.receive(Report{0x43, 0});
  bench.receive(Report{0x15});
  EXPECT_EQ(bench.outputs(), Voltages{}) << "what was latched is gone";
  bench.receive(Report{0x14, 0, 0x00, 0x80, 0});
  EXPECT_DOUBLE_EQ(bench.outputs()[0], kHalf) << "the range is 0 to 10 V again";
}

TEST_F(Usb3103Emulator, SyncsEachLatchOnce) {
  bench.receive(Report{0x14, 0, 0x00, 0xC0, 1});
  bench.receive(Report{0x15});
  bench.receive(Report{0x14, 0, 0x00, 0x80, 0});
  bench.receive(Report{0x15});
  EXPECT_EQ(bench.outputs(), Voltages{});
}

TEST_F(Usb3103Emulator, ObeysNoSyncAsASlave) {
  bench.receive(Report{0x43, 1});
  bench.receive(Report{0x14, 0, 0x00, 0xC0, 1});
  bench.receive(Report{0x15});
  EXPECT_EQ(bench.outputs(), Voltages{});
  EXPECT_EQ(bench.receive(Report{0x44}), (std::vector<Report>{{0x44, 0}}));
}

TEST_F(Usb3103Emulator, GoesToZeroInTheNewRange) {
  bench.receive(Report{0x14, 3, 0x00, 0xC0, 0});
  bench.receive(Report{0x1C, 3, 0});
  EXPECT_EQ(bench.outputs(), Voltages{});
  bench.receive(Report{0x14, 3, 0x00, 0x80, 0});
  EXPECT_EQ(bench.outputs()[3], 5);  // half of 0 to 10 V
}

TEST_F(Usb3103Emulator, WakesUpInTheRangeOfZeroToTenVolts) {
  Bench fresh;
  EXPECT_EQ(fresh.outputs(), Voltages{});
  fresh.receive(Report{0x14, 0, 0x00, 0x80, 0});
  EXPECT_EQ(fresh.outputs()[0],
            5);  // a driver that forgets AOutConfig would drive its coils at "zero"
}

TEST_F(Usb3103Emulator, AnswersMemoryThatItDoesNotHaveWithZeros) {
  const std::vector<Report> zeros{encode_memory({})};
  EXPECT_EQ(bench.receive(Report{0x30, 0x00, 0x00, 0, 62}), zeros);
  EXPECT_EQ(bench.receive(Report{0x30, 0xFF, 0xFF, 0, 62}), zeros);
}

TEST_F(Usb3103Emulator, ChangesNothingForNonsense) {
  bench.receive(Report{0x14, 0, 0x00, 0xC0, 0});
  const Voltages before = bench.outputs();
  std::mt19937 random(1);
  for (int i = 0; i < 20000; ++i) {
    Report report(random() % 8);
    for (auto& byte : report) byte = static_cast<std::uint8_t>(random());
    if (decode_command(report)) continue;
    ASSERT_TRUE(bench.receive(report).empty());
  }
  EXPECT_EQ(bench.outputs(), before);
}

TEST_F(Usb3103Emulator, RefusesACalibrationThatHasNoInverse) {
  EmulatorSettings settings;
  settings.slope[4] = 0;
  EXPECT_THROW(make_emulator(settings, {}), std::invalid_argument);
  settings.slope[4] = 1;
  settings.offset[7] = std::nan("");
  EXPECT_THROW(make_emulator(settings, {}), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::usb3103
