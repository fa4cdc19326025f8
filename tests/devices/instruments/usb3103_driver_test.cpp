// The USB-3103's driver: the dialogue in bytes, and what it does over the emulator.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/usb3103/driver.h"
#include "tests/devices/instruments/usb3103_test_bench.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

namespace vitreo::usb3103 {
namespace VITREO_TEST_FILE {

bool has(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

TEST_F(Usb3103Driver, OpensWithThisDialogue) {
  const auto coils = open_on(bench);
  std::vector<Report> expected{{0x44, 0x00}};
  for (std::uint8_t i = 0; i < 8; ++i) expected.push_back({0x1C, i, 0x01});
  expected.insert(expected.end(), {{0x43, 0x00}, {0x44, 0x00}});
  for (int i = 0; i < 8; ++i)
    expected.push_back({0x30, static_cast<std::uint8_t>(0x08 + 0x10 * i), 0x01, 0x00, 0x08});
  for (std::uint8_t i = 0; i < 8; ++i) expected.push_back({0x14, i, 0x00, 0x80, 0x00});
  expected.push_back({0x44, 0x00});
  EXPECT_EQ(bench.sent, expected);
}

TEST_F(Usb3103Driver, SetsCurrentsWithThisDialogue) {
  const auto coils = open_on(bench);
  bench.sent.clear();
  coils->set_currents(Currents{12, -12, 1, 0, 0, 0, 0, 0});
  const std::vector<Report> expected{{0x14, 0, 0xCD, 0xCC, 1},  // 12 A: 6 V: 52428.8 counts
                                     {0x14, 1, 0x33, 0x33, 1},  // -12 A: -6 V: 13107.2
                                     {0x14, 2, 0x66, 0x86, 1},  // 1 A: 0.5 V: 34406.4
                                     {0x14, 3, 0x00, 0x80, 1},
                                     {0x14, 4, 0x00, 0x80, 1},
                                     {0x14, 5, 0x00, 0x80, 1},
                                     {0x14, 6, 0x00, 0x80, 1},
                                     {0x14, 7, 0x00, 0x80, 1},
                                     {0x15, 0x00},
                                     {0x44, 0x00}};
  EXPECT_EQ(bench.sent, expected);
}

TEST_F(Usb3103Driver, MakesSafeWithThisDialogue) {
  const auto coils = open_on(bench);
  coils->set_currents(kSomeCurrents);
  bench.sent.clear();
  coils->make_safe();
  std::vector<Report> expected;
  for (std::uint8_t i = 0; i < 8; ++i) expected.push_back({0x14, i, 0x00, 0x80, 0x00});
  expected.push_back({0x44, 0x00});
  EXPECT_EQ(bench.sent, expected);
  EXPECT_EQ(bench.outputs(), Voltages{});
  EXPECT_EQ(coils->currents(), Currents(8));
}

TEST_F(Usb3103Driver, StepsAllCoilsTogether) {
  const auto coils = open_on(bench);
  EXPECT_TRUE(bench.steps.empty());  // opening moves nothing that is at rest
  coils->set_currents(kSomeCurrents);
  ASSERT_EQ(bench.steps.size(), 1U);
  for (std::size_t i = 0; i < 8; ++i)
    EXPECT_NEAR(bench.steps[0][i], kSomeCurrents[i] / 2, kCount / 2);
  EXPECT_EQ(coils->currents(), kSomeCurrents);
  coils->set_currents(kSomeCurrents);
  EXPECT_EQ(bench.steps.size(), 1U);  // nothing changed, nothing is told
}

TEST_F(Usb3103Driver, TakesNoLongerThanItsReportsTake) {
  const auto coils = open_on(bench);
  const Time start = clock->now();
  coils->set_currents(kSomeCurrents);
  EXPECT_EQ(clock->now() - start, 11 * kLatency);  // 8 outputs, sync, status and its answer
}

TEST_F(Usb3103Driver, CorrectsTheCalibrationToHalfACount) {
  EmulatorSettings errs;
  for (std::size_t i = 0; i < 8; ++i) {
    errs.slope[i] = 0.93 + 0.02 * static_cast<double>(i);
    errs.offset[i] = -350 + 97.3 * static_cast<double>(i);
  }
  Bench uncalibrated(errs);
  const auto coils = open_on(uncalibrated);
  for (const double volts : uncalibrated.outputs()) EXPECT_NEAR(volts, 0, 0.5 * kCount / 0.93);
  for (double current = -12; current <= 12; current += 0.377) {
    coils->set_currents(Currents(8, current));
    for (std::size_t i = 0; i < 8;
         ++i)  // half a count of the DAC is 1/slope of that at the terminals
      ASSERT_NEAR(uncalibrated.outputs()[i], current / 2, 0.5001 * kCount / errs.slope[i]) << i;
  }
}

TEST_F(Usb3103Driver, UsesAnImplausibleCalibrationAsIfItWereIdeal) {
  bench.answer_with(kMemoryRead, {encode_memory(Report(8, 0xFF))});  // an erased flash
  const auto coils = open_on(bench);
  coils->set_currents(kSomeCurrents);
  for (std::size_t i = 0; i < 8; ++i)
    EXPECT_NEAR(bench.outputs()[i], kSomeCurrents[i] / 2, kCount / 2);
}

TEST_F(Usb3103Driver, ZeroesWhatAHostThatDiedLeftBehind) {
  auto coils = open_on(bench);
  coils->set_currents(kSomeCurrents);
  cable.writes_left = 0;
  coils.reset();
  EXPECT_NE(bench.outputs(), Voltages{});  // no watchdog
  cable.writes_left = -1;
  coils = open_on(bench);
  EXPECT_EQ(bench.outputs(), Voltages{});
}

TEST_F(Usb3103Driver, ZeroesWhenItIsDestroyed) {
  auto coils = open_on(bench);
  coils->set_currents(kSomeCurrents);
  coils.reset();
  EXPECT_EQ(bench.outputs(), Voltages{});
}

TEST_F(Usb3103Driver, SendsNothingForWrongArguments) {
  const auto coils = open_on(bench);
  coils->set_currents(kSomeCurrents);
  bench.sent.clear();
  EXPECT_THROW(coils->set_currents(Currents(7)), std::invalid_argument);
  EXPECT_THROW(coils->set_currents(Currents(9)), std::invalid_argument);
  EXPECT_THROW(coils->set_currents(Currents{0, 0, 0, 0, 0, 0, 0, std::nan("")}),
               std::invalid_argument);
  EXPECT_THROW(coils->set_currents(Currents{0, 0, 0, 0, 0, 0, 0, -INFINITY}),
               std::invalid_argument);
  EXPECT_EQ(kind_of([&] {
              coils->set_currents(Currents{0, 0, 0, 0, 0, 0, 0, -12.01});
            }),
            DeviceErrorKind::refused);
  EXPECT_TRUE(bench.sent.empty());
  EXPECT_EQ(coils->currents(), kSomeCurrents);
}

TEST_F(Usb3103Driver, SaysWhichCurrentIsBeyondTheLimit) {
  const auto coils = open_on(bench);
  try {
    coils->set_currents(Currents{0, 0, 0, 13, 0, 0, 0, 0});
    FAIL() << "no error";
  } catch (const DeviceError& error) {
    EXPECT_STREQ(error.what(), "coils: 13 A on channel 3 is beyond the limit of 12 A (refused)");
  }
}

TEST(Usb3103Settings, AreCheckedByName) {
  const auto complaint = [](Settings settings) -> std::string {
    try {
      settings.check();
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(complaint({}), "");
  EXPECT_TRUE(has(complaint({.name = ""}), "name"));
  EXPECT_TRUE(has(complaint({.amperes_per_volt = 0}), "amperes_per_volt"));
  EXPECT_TRUE(has(complaint({.amperes_per_volt = std::nan("")}), "amperes_per_volt"));
  EXPECT_TRUE(has(complaint({.current_limit = -1}), "current_limit"));
  EXPECT_TRUE(has(complaint({.current_limit = 21}), "current_limit"));  // 2 A/V x 10 V = 20 A
  EXPECT_TRUE(has(complaint({.reply_timeout = 0}), "reply_timeout"));
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::usb3103
