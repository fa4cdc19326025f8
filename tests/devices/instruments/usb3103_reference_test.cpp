// The USB-3103's driver by every byte it sends and every voltage these make, computed from the fact
// sheet's numbers.
// SPDX-License-Identifier: Apache-2.0
#include "tests/devices/instruments/usb3103_reference.h"

#include "devices/instruments/usb3103/driver.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <vector>

namespace vitreo::usb3103 {
namespace VITREO_TEST_FILE {

using reference::Bytes;
using reference::error_of;
using reference::Terminals;
using Reports = std::vector<Bytes>;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// The two bytes of the count that makes `volts`, by exact sums of doubles in long double.
Bytes counts(double volts, float slope, float offset) {
  const long double step = 10.0L / 32768;
  long double count = slope * (static_cast<long double>(volts) / step + 32768) + offset;
  count = std::floor(count + 0.5L);
  const int whole = count < 0 ? 0 : count > 65535 ? 65535 : static_cast<int>(count);
  return {static_cast<std::uint8_t>(whole % 256), static_cast<std::uint8_t>(whole / 256)};
}
Bytes analog(int channel, const Bytes& count, bool latched) {
  return {0x14, static_cast<std::uint8_t>(channel), count[0], count[1],
          static_cast<std::uint8_t>(latched ? 1 : 0)};
}
Reports zeros(const Terminals& far) {
  Reports reports;
  for (std::size_t i = 0; i < 8; ++i)
    reports.push_back(analog(static_cast<int>(i), counts(0, far.slope[i], far.offset[i]), false));
  return reports;
}
Reports update(const Terminals& far, const std::vector<double>& volts) {
  Reports reports;
  for (std::size_t i = 0; i < 8; ++i)
    reports.push_back(
        analog(static_cast<int>(i), counts(volts[i], far.slope[i], far.offset[i]), true));
  reports.push_back({0x15, 0});
  reports.push_back({0x44, 0});
  return reports;
}
void append(Reports& to, const Reports& from) { to.insert(to.end(), from.begin(), from.end()); }

class Usb3103Reference : public testing::Test {
 protected:
  Usb3103Reference() {
    for (std::size_t i = 0; i < 8; ++i) {  // none like another, none ideal
      far_.slope[i] = 0.93F + 0.011F * static_cast<float>(i);
      far_.offset[i] = -71.3F + 23.9F * static_cast<float>(i);
    }
  }
  std::unique_ptr<CoilAmplifier> opened() { return open(far_.link(), settings_, *clock_); }

  std::unique_ptr<Clock> clock_ = virtual_clock();
  Terminals far_{*clock_};
  Settings settings_;
};

TEST_F(Usb3103Reference, opening_zeroes_disables_and_then_asks_for_the_calibration) {
  for (const std::optional<int> line : {std::optional<int>{}, {0}, {5}, {7}}) {
    settings_.enable_line = line;
    far_.news();
    const auto amplifier = opened();
    const auto number = static_cast<std::uint8_t>(line.value_or(0));
    Reports expected{{0x44, 0}};
    for (std::uint8_t i = 0; i < 8; ++i) expected.push_back({0x1C, i, 1});
    // Low before it becomes an output, or the amplifiers would be enabled for a moment.
    if (line) append(expected, {{0x06, number, 0}, {0x02, number, 0}});
    append(expected, {{0x43, 0}, {0x44, 0}});
    for (std::uint8_t i = 0; i < 8; ++i)
      expected.push_back({0x30, static_cast<std::uint8_t>(0x08 + 0x10 * i), 0x01, 0, 8});
    append(expected, zeros(far_));
    if (line) expected.push_back({0x06, number, 0});
    expected.push_back({0x44, 0});
    EXPECT_EQ(far_.news(), expected);
    EXPECT_EQ(amplifier->channels(), 8);
    EXPECT_EQ(amplifier->current_limit(), 12);
    EXPECT_EQ(amplifier->identity(), "Measurement Computing USB-3103, 8 x +-10 V");
    EXPECT_EQ(amplifier->currents(), std::vector<double>(8, 0.0));
    EXPECT_EQ(amplifier->enable_line(), nullptr);
  }
}

TEST_F(Usb3103Reference, set_points_are_latched_and_step_together_at_the_sync) {
  settings_.amperes_per_volt = 1.7;
  settings_.current_limit = 16.5;
  const auto amplifier = opened();
  far_.news();
  std::mt19937_64 random(3103);
  std::uniform_real_distribution<double> current(-16.5, 16.5);
  for (int turn = 0; turn < 50; ++turn) {
    std::vector<double> currents(8), volts(8);
    for (std::size_t i = 0; i < 8; ++i) {
      currents[i] = current(random);
      volts[i] = currents[i] / 1.7;
    }
    const auto before = far_.volts;
    far_.refuses = [&](const Bytes& b) {  // nothing moves until the sync
      EXPECT_TRUE(b[0] != 0x14 || far_.volts == before);
      return false;
    };
    amplifier->set_currents(currents);
    far_.refuses = nullptr;
    EXPECT_EQ(far_.news(), update(far_, volts)) << turn;
    EXPECT_EQ(amplifier->currents(), currents);
    for (std::size_t i = 0; i < 8; ++i)  // half a step of the DAC
      EXPECT_NEAR(far_.volts[i], volts[i], 0.5 * 20 / 65536 / far_.slope[i] + 1e-12) << i;
  }
}

TEST_F(Usb3103Reference, each_output_reaches_both_ends_of_its_range_and_stays_there) {
  settings_.amperes_per_volt = 1.25;
  settings_.current_limit = 12.5;  // as much as 10 V ask for
  far_.slope.fill(1);
  far_.offset.fill(0);
  far_.slope[6] = 1.02F;  // beyond the DAC's ends, which must not wrap
  far_.slope[7] = 0.95F;
  const auto amplifier = opened();
  for (std::size_t i = 0; i < 8; ++i) {
    for (const double sign : {-1., 1.}) {
      std::vector<double> currents(8, 0.0), volts(8, 0.0);
      currents[i] = sign * 12.5;
      volts[i] = sign * 10;
      far_.news();
      amplifier->set_currents(currents);
      EXPECT_EQ(far_.news(), update(far_, volts)) << i;
      const int full[] = {0, i == 7 ? 62259 : 65535};
      const Bytes& sent = far_.taken[far_.taken.size() - 10 + i];
      EXPECT_EQ(sent[2] + 256 * sent[3], full[sign > 0]) << i;
    }
  }
}

TEST_F(Usb3103Reference, refuses_what_is_beyond_a_limit_of_any_channel_and_changes_nothing) {
  settings_.name = "left coils";
  settings_.current_limit = 3.5;
  settings_.enable_line = 4;
  const auto amplifier = opened();
  const std::vector<double> before{1, -2, 3, -3.5, 3.5, -0.5, 0.25, -1.75};
  amplifier->set_currents(before);
  far_.news();
  for (std::size_t i = 0; i < 8; ++i) {
    const std::string channel = "channel " + std::to_string(i);
    const auto with = [&](double value) {
      std::vector<double> currents = before;
      currents[i] = value;
      return error_of([&] { amplifier->set_currents(currents); });
    };
    EXPECT_EQ(with(4.25),
              "refused: left coils: 4.25 A on " + channel + " is beyond the limit of 3.5 A");
    EXPECT_EQ(with(-4.25),
              "refused: left coils: -4.25 A on " + channel + " is beyond the limit of 3.5 A");
    EXPECT_NE(with(std::nextafter(3.5, 4)), "");
    EXPECT_NE(with(std::nextafter(-3.5, -4)), "");
    for (const double bad : {kNan, kInfinity, -kInfinity})
      EXPECT_EQ(with(bad), "invalid: currents: " + channel + " is not a finite number");
    EXPECT_EQ(far_.news(), Reports{});
    EXPECT_EQ(amplifier->currents(), before);
    EXPECT_TRUE(far_.line_is_high(4));
    EXPECT_EQ(with(3.5), "");
    EXPECT_EQ(with(-3.5), "");
    amplifier->set_currents(before);
    far_.news();
  }
  for (const std::size_t size : {0, 1, 7, 9, 16}) {
    const std::vector<double> currents(size, 0.5);
    EXPECT_EQ(error_of([&] { amplifier->set_currents(currents); }),
              "invalid: currents: left coils has 8 channels, not " + std::to_string(size));
  }
  EXPECT_EQ(far_.news(), Reports{});
  EXPECT_EQ(amplifier->current_limit(), 3.5);
}

TEST_F(Usb3103Reference, an_implausible_calibration_of_a_channel_is_replaced_by_the_ideal_one) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinity = std::numeric_limits<float>::infinity();
  struct Case {
    float slope, offset;
    int zero;  // counts of 0 V
  };
  const std::vector<Case> cases{{0.9F, 0, 29491},  // 29491.2
                                {1.1F, 0, 36045},  // 36044.8
                                {std::nextafter(0.9F, 0.0F), 0, 32768},
                                {std::nextafter(1.1F, 2.0F), 0, 32768},
                                {-1, 0, 32768},
                                {nan, 0, 32768},
                                {infinity, 0, 32768},
                                {1, 1999.75F, 34768},
                                {1, -1999.75F, 30768},
                                {1, 2000, 32768},
                                {1, -2000, 32768},
                                {1, nan, 32768},
                                {1, -infinity, 32768},
                                {0.5F, 100, 32768},
                                {1.05F, 2500, 32768}};
  for (const std::size_t channel : {0, 3, 7}) {
    for (const Case& c : cases) {
      Terminals far(*clock_);
      far.slope = far_.slope;
      far.offset = far_.offset;
      far.slope[channel] = c.slope;
      far.offset[channel] = c.offset;
      const auto amplifier = open(far.link(), settings_, *clock_);
      far.slope = far_.slope;  // to compute the other channels' zeros with
      far.offset = far_.offset;
      Reports expected = zeros(far);
      expected[channel][2] = static_cast<std::uint8_t>(c.zero % 256);
      expected[channel][3] = static_cast<std::uint8_t>(c.zero / 256);
      const Reports last(far.taken.end() - 9, far.taken.end() - 1);
      EXPECT_EQ(last, expected) << channel << " " << c.slope << " " << c.offset;
    }
  }
}

TEST_F(Usb3103Reference, has_no_read_back_but_asks) {
  const auto amplifier = opened();
  amplifier->set_currents(std::vector<double>{1, 2, 3, 4, 5, 6, 7, 8});
  far_.news();
  EXPECT_EQ(amplifier->measured_currents(), std::nullopt);
  EXPECT_EQ(far_.news(), (Reports{{0x44, 0}}));
  EXPECT_EQ(amplifier->currents()[6], 7);
}

TEST_F(Usb3103Reference, the_enable_line_is_high_with_the_first_currents_and_low_when_safe) {
  for (const int line : {0, 7}) {
    settings_.enable_line = line;
    const auto number = static_cast<std::uint8_t>(line);
    auto amplifier = opened();
    EXPECT_TRUE(far_.output_line[number]);
    EXPECT_FALSE(far_.line_is_high(line));
    for (int turn = 0; turn < 2; ++turn) {
      far_.news();
      const std::vector<double> currents{1, -2, 3, -4, 5, -6, 7, 0}, other(8, -0.5);
      amplifier->set_currents(currents);
      Reports expected{{0x06, number, 1}};
      append(expected, update(far_, {0.5, -1, 1.5, -2, 2.5, -3, 3.5, 0}));
      EXPECT_EQ(far_.news(), expected);
      amplifier->set_currents(other);  // once is enough
      EXPECT_EQ(far_.news(), update(far_, std::vector<double>(8, -0.25)));
      EXPECT_TRUE(far_.line_is_high(line));
      expected = zeros(far_);
      append(expected, {{0x06, number, 0}, {0x44, 0}});
      for (int again = 0; again < 2; ++again) {  // idempotent, and sent each time
        amplifier->make_safe();
        EXPECT_EQ(far_.news(), expected);
        EXPECT_EQ(amplifier->currents(), std::vector<double>(8, 0.0));
        EXPECT_FALSE(far_.line_is_high(line));
      }
    }
    amplifier->set_currents(std::vector<double>(8, 2.0));
    far_.news();
    amplifier.reset();
    Reports expected = zeros(far_);
    append(expected, {{0x06, number, 0}, {0x44, 0}});
    EXPECT_EQ(far_.news(), expected);
    EXPECT_FALSE(far_.line_is_high(line));
  }
}

TEST_F(Usb3103Reference, without_a_line_no_digital_report_is_sent) {
  auto amplifier = opened();
  amplifier->set_currents(std::vector<double>(8, 2.0));
  far_.news();
  amplifier->make_safe();
  Reports expected = zeros(far_);
  expected.push_back({0x44, 0});
  EXPECT_EQ(far_.news(), expected);
  amplifier.reset();
  for (const Bytes& report : far_.taken) EXPECT_TRUE(report[0] != 0x02 && report[0] != 0x06);
}

TEST_F(Usb3103Reference, a_heartbeats_line_is_left_to_it_by_set_points_and_low_when_safe) {
  settings_.enable_line = 6;
  settings_.heartbeat = true;
  auto amplifier = opened();
  EnableLine* line = amplifier->enable_line();
  ASSERT_NE(line, nullptr);
  EXPECT_EQ(line->identity(), "digital line 6 of " + amplifier->identity());
  EXPECT_FALSE(line->high());
  EXPECT_TRUE(far_.output_line[6]);
  far_.news();
  amplifier->set_currents(std::vector<double>(8, 3.0));
  EXPECT_EQ(far_.news(), update(far_, std::vector<double>(8, 1.5)));
  for (const bool high : {true, true, false, true}) {
    line->set(high);
    EXPECT_EQ(far_.news(), (Reports{{0x06, 6, static_cast<std::uint8_t>(high ? 1 : 0)}}));
    EXPECT_EQ(line->high(), high);
  }
  amplifier->set_currents(std::vector<double>(8, 3.0));
  EXPECT_TRUE(far_.line_is_high(6) && line->high());
  far_.news();
  line->make_safe();
  EXPECT_EQ(far_.news(), (Reports{{0x06, 6, 0}}));
  EXPECT_FALSE(line->high());
  EXPECT_EQ(amplifier->currents(), std::vector<double>(8, 3.0));
  line->set(true);
  amplifier->make_safe();
  EXPECT_FALSE(far_.line_is_high(6) || line->high());
  line->set(true);
  amplifier.reset();
  EXPECT_FALSE(far_.line_is_high(6));
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::usb3103
