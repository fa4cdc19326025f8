// Bytes, counts and times of a USB-3103 against the fact sheet's tables, and the driver's settings
// against their bounds.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/usb3103/driver.h"
#include "devices/instruments/usb3103/timing.h"
#include "devices/instruments/usb3103/wire.h"
#include "tests/devices/instruments/usb3103_reference.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <string>
#include <variant>
#include <vector>

namespace vitreo::usb3103 {
namespace VITREO_TEST_FILE {

using reference::error_of;
using reference::Terminals;
using Reports = std::vector<Report>;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kTiny = std::numeric_limits<double>::denorm_min();

/// A command's fields as numbers, for comparison; the first is its kind.
std::vector<int> fields(const std::optional<Command>& command) {
  if (!command) return {};
  struct Fields {
    std::vector<int> operator()(const AnalogOut& c) const {
      return {0x14, c.channel, c.counts, c.latched};
    }
    std::vector<int> operator()(const AnalogOutSync&) const { return {0x15}; }
    std::vector<int> operator()(const AnalogOutConfig& c) const {
      return {0x1C, c.channel, static_cast<int>(c.range)};
    }
    std::vector<int> operator()(const SetSync& c) const { return {0x43, c.master}; }
    std::vector<int> operator()(const MemoryRead& c) const { return {0x30, c.address, c.count}; }
    std::vector<int> operator()(const GetStatus&) const { return {0x44}; }
    std::vector<int> operator()(const DigitalConfig& c) const { return {0x02, c.line, c.input}; }
    std::vector<int> operator()(const DigitalOut& c) const { return {0x06, c.line, c.high}; }
  };
  return std::visit(Fields{}, *command);
}

TEST(Usb3103Bytes, each_command_is_the_fact_sheets_bytes_both_ways) {
  const std::vector<std::pair<Command, Report>> pairs{
      {AnalogOut{7, 0xA5C3, true}, {0x14, 7, 0xC3, 0xA5, 1}},
      {AnalogOut{0, 0x0180, false}, {0x14, 0, 0x80, 0x01, 0}},
      {AnalogOutSync{}, {0x15, 0}},
      {AnalogOutConfig{7, Range::plus_minus_10_v}, {0x1C, 7, 1}},
      {AnalogOutConfig{3, Range::zero_to_10_v}, {0x1C, 3, 0}},
      {SetSync{true}, {0x43, 0}},
      {SetSync{false}, {0x43, 1}},
      {MemoryRead{0x0178, 62}, {0x30, 0x78, 0x01, 0, 62}},
      {MemoryRead{0x00FF, 0}, {0x30, 0xFF, 0x00, 0, 0}},
      {GetStatus{}, {0x44, 0}},
      {DigitalConfig{7, true}, {0x02, 7, 1}},
      {DigitalConfig{4, false}, {0x02, 4, 0}},
      {DigitalOut{7, true}, {0x06, 7, 1}},
      {DigitalOut{2, false}, {0x06, 2, 0}}};
  for (const auto& [command, report] : pairs) {
    EXPECT_EQ(encode(command), report);
    EXPECT_EQ(fields(decode_command(report)), fields(command));
    Report padded = report;
    padded.resize(64, 0xEE);
    EXPECT_EQ(fields(decode_command(padded)), fields(command));
    if (report[0] == 0x15 || report[0] == 0x44) {  // one byte on the wire, padded to two
      EXPECT_EQ(fields(decode_command(Report{report[0]})), fields(command));
      continue;
    }
    for (std::size_t size = 0; size < report.size(); ++size)
      EXPECT_FALSE(decode_command(Bytes(report).first(size))) << size;
  }
}

TEST(Usb3103Bytes, what_the_device_would_not_understand_is_nothing) {
  for (const Report& report : Reports{{},
                                      {0x14, 8, 0, 0, 0},
                                      {0x14, 0, 0, 0, 2},
                                      {0x14, 255, 0, 0, 1},
                                      {0x1C, 8, 1},
                                      {0x1C, 0, 2},
                                      {0x43, 2},
                                      {0x30, 0, 1, 0, 63},
                                      {0x02, 8, 0},
                                      {0x02, 0, 2},
                                      {0x06, 8, 0},
                                      {0x06, 0, 2},
                                      {0x41, 0},
                                      {0x31, 0, 1, 1, 7},
                                      {0x00, 0, 0, 0, 0}})
    EXPECT_FALSE(decode_command(report)) << testing::PrintToString(report);
}

TEST(Usb3103Bytes, the_status_has_the_master_in_its_lowest_bit) {
  EXPECT_EQ(encode_status({true}), (Report{0x44, 1}));
  EXPECT_EQ(encode_status({false}), (Report{0x44, 0}));
  EXPECT_TRUE(decode_status(Report{0x44, 0x01})->master);
  EXPECT_TRUE(decode_status(Report{0x44, 0xFF, 0})->master);
  EXPECT_FALSE(decode_status(Report{0x44, 0xFE, 1})->master);
  for (const Report& report : Reports{{}, {0x44}, {0x43, 1}, {0x30, 1}})
    EXPECT_FALSE(decode_status(report));
}

TEST(Usb3103Bytes, the_calibration_is_two_floats_with_the_low_byte_first) {
  // IEEE 754: 1.03125 is 0x3F840000, -1234.5 is 0xC49A5000, 1.0000001 is 0x3F800001.
  const std::array<std::uint8_t, 8> bytes{0x00, 0x00, 0x84, 0x3F, 0x00, 0x50, 0x9A, 0xC4};
  EXPECT_EQ(encode_calibration({1.03125F, -1234.5F}), bytes);
  EXPECT_EQ(encode_calibration({std::nextafter(1.0F, 2.0F), 0})[0], 0x01);
  EXPECT_EQ(encode_calibration({1, std::nextafter(1.0F, 2.0F)})[4], 0x01);
  const Report report = encode_memory(bytes);
  ASSERT_EQ(report.size(), 63U);
  EXPECT_EQ(report[0], 0x30);
  EXPECT_EQ(std::vector<std::uint8_t>(report.begin() + 9, report.end()),
            std::vector<std::uint8_t>(54, 0));
  const auto calibration = decode_calibration(report);
  ASSERT_TRUE(calibration);
  EXPECT_EQ(calibration->slope, 1.03125F);
  EXPECT_EQ(calibration->offset, -1234.5F);
  EXPECT_TRUE(decode_calibration(Bytes(report).first(9)));
  EXPECT_FALSE(decode_calibration(Bytes(report).first(8)));
  EXPECT_FALSE(decode_calibration(Report{}));
  Report other = report;
  other[0] = 0x31;
  EXPECT_FALSE(decode_calibration(other));
  const int addresses[] = {0x108, 0x118, 0x128, 0x138, 0x148, 0x158, 0x168, 0x178};
  for (int i = 0; i < 8; ++i) EXPECT_EQ(calibration_address(i), addresses[i]);
}

TEST(Usb3103Bytes, counts_and_volts_are_the_fact_sheets_straight_lines) {
  EXPECT_EQ(counts_from_volts(0, {}), 0x8000);
  EXPECT_EQ(counts_from_volts(10, {}), 0xFFFF);  // 65536 does not fit
  EXPECT_EQ(counts_from_volts(-10, {}), 0);
  EXPECT_EQ(counts_from_volts(-11, {}), 0);
  EXPECT_EQ(counts_from_volts(1e9, {}), 0xFFFF);
  EXPECT_EQ(counts_from_volts(5, {}), 0xC000);
  EXPECT_EQ(counts_from_volts(0, {1, 0.75F}), 32769);  // rounded, not truncated
  EXPECT_EQ(counts_from_volts(0, {1, -0.75F}), 32767);
  EXPECT_EQ(counts_from_volts(0, {1, 0.25F}), 32768);
  EXPECT_EQ(volts_from_counts(65535, Range::zero_to_10_v, {1.1F, 99}), 65535 * 10 / 65536.);
  EXPECT_EQ(volts_from_counts(0, Range::zero_to_10_v, {1.1F, 99}), 0);
  EXPECT_EQ(volts_from_counts(0, Range::plus_minus_10_v, {}), -10);
  EXPECT_EQ(volts_from_counts(0xC000, Range::plus_minus_10_v, {}), 5);
  std::mt19937_64 random(16);
  std::uniform_real_distribution<double> volts(-8, 8);
  std::uniform_real_distribution<float> slope(0.9F, 1.1F), offset(-1999, 1999);
  for (int i = 0; i < 1000; ++i) {
    const Calibration calibration{slope(random), offset(random)};
    const double v = volts(random);
    const std::uint16_t counts = counts_from_volts(v, calibration);
    const double wanted = calibration.slope * (v / 20 * 65536 + 32768) + calibration.offset;
    if (wanted > 65535) continue;
    EXPECT_NEAR(counts, wanted, 0.5 + 1e-9);
    EXPECT_NEAR(volts_from_counts(counts, Range::plus_minus_10_v, calibration), v,
                (0.5 + 1e-9) * 20 / 65536 / calibration.slope);
  }
}

TEST(Usb3103Bytes, an_update_is_eleven_transfers) {
  EXPECT_NEAR(update_time(0.001).seconds, 0.011, 1e-15);
  EXPECT_NEAR(update_time(0.004).seconds, 0.044, 1e-15);
  EXPECT_EQ(update_time(0.002).arithmetic, usb_time(11, 0.002).arithmetic);
}

TEST(Usb3103Settings, each_is_refused_by_name) {
  const auto check = [](const std::function<void(Settings&)>& change) {
    Settings settings;
    change(settings);
    return error_of([&] { settings.check(); });
  };
  EXPECT_EQ(check([](Settings&) {}), "");
  EXPECT_EQ(check([](Settings& s) { s.name = ""; }), "invalid: name: must not be empty");
  for (const double bad : {0., -kTiny, -1., kNan, kInfinity, -kInfinity}) {
    EXPECT_EQ(check([&](Settings& s) { s.amperes_per_volt = bad; }),
              "invalid: amperes_per_volt: must be positive");
    EXPECT_EQ(check([&](Settings& s) { s.current_limit = bad; }),
              "invalid: current_limit: must be positive");
    EXPECT_EQ(check([&](Settings& s) { s.reply_timeout = bad; }),
              "invalid: reply_timeout: must be positive");
  }
  EXPECT_EQ(check([](Settings& s) { s.current_limit = kTiny; }), "");
  EXPECT_EQ(check([](Settings& s) { s.reply_timeout = kTiny; }), "");
  // Ten volts ask for as much as this.
  EXPECT_EQ(check([](Settings& s) { s.current_limit = 20; }), "");
  EXPECT_EQ(check([](Settings& s) { s.current_limit = 20.5; }),
            "invalid: current_limit: 20.5 A is more than +-10 V can ask for");
  EXPECT_EQ(check([](Settings& s) { s.amperes_per_volt = 1.2; }), "");
  EXPECT_EQ(check([](Settings& s) { s.amperes_per_volt = 1.1; }),
            "invalid: current_limit: 12 A is more than +-10 V can ask for");
  for (const int line : {0, 7}) EXPECT_EQ(check([&](Settings& s) { s.enable_line = line; }), "");
  for (const int line : {-1, 8, -8, 255})
    EXPECT_EQ(check([&](Settings& s) { s.enable_line = line; }),
              "invalid: enable_line: must be 0 to 7");
  EXPECT_EQ(check([](Settings& s) { s.heartbeat = true; }),
            "invalid: heartbeat: wants the line that it toggles, enable_line");
  const auto clock = virtual_clock();
  Terminals far(*clock);
  Settings wrong;
  wrong.current_limit = 20.5;  // open() checks them too, before anything is sent
  EXPECT_EQ(error_of([&] { open(far.link(), wrong, *clock); }),
            "invalid: current_limit: 20.5 A is more than +-10 V can ask for");
  EXPECT_EQ(far.news(), Reports{});
  EXPECT_EQ(error_of([&] { open(nullptr, Settings{}, *clock); }),
            "invalid: link: must not be null");
}

TEST(Usb3103Settings, a_timeout_that_does_not_fit_is_refused_by_name) {
  const auto clock = virtual_clock();
  Terminals far(*clock);
  Settings settings;
  settings.reply_timeout = 60;
  EXPECT_EQ(error_of([&] { settings.check(); }), "");
  settings.reply_timeout = 1e10;
  EXPECT_EQ(error_of([&] { settings.check(); }).substr(0, 23), "invalid: reply_timeout:");
  EXPECT_EQ(error_of([&] { open(far.link(), settings, *clock); }).substr(0, 23),
            "invalid: reply_timeout:");
  EXPECT_EQ(far.news(), Reports{});
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::usb3103
