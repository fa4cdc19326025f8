// The USB-3103's reports, byte by byte (facts: the tables of wjasper's driver for this instrument).
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/usb3103/wire.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

namespace vitreo::usb3103 {
namespace VITREO_TEST_FILE {

TEST(Usb3103Wire, EncodesCommandsAsTheInstrumentExpectsThem) {
  EXPECT_EQ(encode(AnalogOut{3, 0x8123, true}), (Report{0x14, 3, 0x23, 0x81, 1}));
  EXPECT_EQ(encode(AnalogOut{7, 0xFFFF, false}), (Report{0x14, 7, 0xFF, 0xFF, 0}));
  EXPECT_EQ(encode(AnalogOutSync{}), (Report{0x15, 0x00})) << "hidraw refuses one byte";
  EXPECT_EQ(encode(AnalogOutConfig{2, Range::plus_minus_10_v}), (Report{0x1C, 2, 1}));
  EXPECT_EQ(encode(MemoryRead{0x0178, 8}), (Report{0x30, 0x78, 0x01, 0, 8}));
  EXPECT_EQ(encode(SetSync{.master = true}), (Report{0x43, 0}));
  EXPECT_EQ(encode(SetSync{.master = false}), (Report{0x43, 1}));
  EXPECT_EQ(encode(GetStatus{}), (Report{0x44, 0x00}));
}

TEST(Usb3103Wire, DecodesWhatItEncodes) {
  const std::vector<Command> commands{AnalogOut{5, 0x1234, true},
                                      AnalogOut{0, 0, false},
                                      AnalogOutSync{},
                                      AnalogOutConfig{7, Range::zero_to_10_v},
                                      SetSync{true},
                                      SetSync{false},
                                      MemoryRead{0x2FF, 62},
                                      GetStatus{}};
  for (const Command& command : commands) {
    const Report report = encode(command);
    const auto decoded = decode_command(report);
    ASSERT_TRUE(decoded) << command.index();
    EXPECT_EQ(decoded->index(), command.index());
    EXPECT_EQ(encode(*decoded), report);
    Report padded(64);  // to the size of the endpoint
    std::copy(report.begin(), report.end(), padded.begin());
    ASSERT_TRUE(decode_command(padded)) << command.index();
    EXPECT_EQ(decode_command(padded)->index(), command.index());
  }
}

TEST(Usb3103Wire, DecodesNoNonsense) {
  const std::vector<Report> nonsense{{},
                                     {0x00},
                                     {0xFF, 1, 2, 3},
                                     {0x14},
                                     {0x14, 0, 0, 0x80},     // cut short
                                     {0x14, 8, 0, 0x80, 0},  // no such channel
                                     {0x14, 0, 0, 0x80, 2},  // no such update
                                     {0x1C, 0},
                                     {0x1C, 8, 1},
                                     {0x1C, 0, 2},
                                     {0x30, 0, 1, 0},
                                     {0x30, 0, 1, 0, 63},  // more than a report holds
                                     {0x43},
                                     {0x43, 2}};
  for (const Report& report : nonsense)
    EXPECT_FALSE(decode_command(report)) << ::testing::PrintToString(report);
}

TEST(Usb3103Wire, DecodesTheStatus) {
  EXPECT_EQ(encode_status({true}), (Report{0x44, 1}));
  EXPECT_TRUE(decode_status(Report{0x44, 1})->master);
  EXPECT_FALSE(decode_status(Report{0x44, 0xFE, 0})->master);  // the other bits mean nothing
  EXPECT_FALSE(decode_status(Report{0x44}));
  EXPECT_FALSE(decode_status(Report{0x30, 1}));
  EXPECT_FALSE(decode_status(Report{}));
}

TEST(Usb3103Wire, DecodesACalibrationOfTwoLittleEndianFloats) {
  const Report report = encode_memory(Report{0x00, 0x00, 0x80, 0x3F, 0x00, 0x00, 0x20, 0xC1});
  EXPECT_EQ(report.size(), 63U);
  const auto calibration = decode_calibration(report);
  ASSERT_TRUE(calibration);
  EXPECT_EQ(calibration->slope, 1.F);
  EXPECT_EQ(calibration->offset, -10.F);
  const auto bytes = encode_calibration(*calibration);
  EXPECT_EQ(encode_memory(bytes), report);
  EXPECT_FALSE(decode_calibration(Report{0x30, 0, 0, 0x80, 0x3F, 0, 0, 0}));
  EXPECT_FALSE(decode_calibration(Report{}));
}

TEST(Usb3103Wire, BelievesOnlyAPlausibleCalibration) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_TRUE((Calibration{1.01F, -120.F}.plausible()));
  EXPECT_FALSE((Calibration{0.8F, 0.F}.plausible()));
  EXPECT_FALSE((Calibration{1.F, 2000.F}.plausible()));
  EXPECT_FALSE((Calibration{kNan, 0.F}.plausible()));
  EXPECT_FALSE((Calibration{1.F, kNan}.plausible()));
}

TEST(Usb3103Wire, TurnsVoltsIntoRoundedCounts) {
  const Calibration ideal;
  EXPECT_EQ(counts_from_volts(0, ideal), 0x8000);
  EXPECT_EQ(counts_from_volts(6, ideal), 52429);   // 52428.8
  EXPECT_EQ(counts_from_volts(-6, ideal), 13107);  // 13107.2
  EXPECT_EQ(counts_from_volts(10, ideal), 0xFFFF);
  EXPECT_EQ(counts_from_volts(11, ideal), 0xFFFF);
  EXPECT_EQ(counts_from_volts(-11, ideal), 0);
  EXPECT_EQ(counts_from_volts(0, {1.F, -10.F}), 0x7FF6);
}

TEST(Usb3103Wire, TurnsCountsIntoTerminalVolts) {
  EXPECT_DOUBLE_EQ(volts_from_counts(0x8000, Range::plus_minus_10_v, {}), 0);
  EXPECT_DOUBLE_EQ(volts_from_counts(0, Range::plus_minus_10_v, {}), -10);
  EXPECT_DOUBLE_EQ(volts_from_counts(0x8000, Range::zero_to_10_v, {}), 5);
  EXPECT_DOUBLE_EQ(volts_from_counts(0x7FF6, Range::plus_minus_10_v, {1.F, -10.F}), 0);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::usb3103
