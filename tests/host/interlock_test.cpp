// The interlock refuses what is beyond its limits, and refusing means zero.
// SPDX-License-Identifier: Apache-2.0
#include "host/interlock.h"

#include "devices/error.h"

#include <gtest/gtest.h>

#include <cmath>

namespace vitreo {
namespace {

class FakeAmplifier : public CoilAmplifier {
 public:
  std::string identity() const override { return "fake"; }
  int channels() const override { return 3; }
  double current_limit() const override { return 10; }
  void set_currents(std::span<const double> currents) override { set.assign(currents.begin(), currents.end()); }
  std::vector<double> currents() const override { return set; }
  void make_safe() override {
    set.assign(3, 0);
    ++made_safe;
  }
  std::vector<double> set{0, 0, 0};
  int made_safe = 0;
};

struct InterlockTest : testing::Test {
  FakeAmplifier amplifier;
  Interlock interlock{amplifier, {5, 12}};
  void expect_refused(const std::vector<double>& currents, const std::string& why) {
    interlock.enable();
    interlock.set_currents(std::vector<double>{1, 1, 1});
    try {
      interlock.set_currents(currents);
      FAIL() << "taken";
    } catch (const DeviceError& error) {
      EXPECT_EQ(error.kind, DeviceErrorKind::refused);
      EXPECT_NE(std::string(error.what()).find(why), std::string::npos) << error.what();
    }
    EXPECT_EQ(amplifier.set, (std::vector<double>{0, 0, 0}));
  }
};

TEST_F(InterlockTest, WhatIsWithinTheLimitsPasses) {
  interlock.set_currents(std::vector<double>{5, -5, 2});
  EXPECT_EQ(amplifier.set, (std::vector<double>{5, -5, 2}));
}

TEST_F(InterlockTest, BeyondTheLimitOfACoilMeansZero) { expect_refused({0, -5.01, 0}, "coil 2"); }
TEST_F(InterlockTest, BeyondTheTotalMeansZero) { expect_refused({4.5, 4.5, -4.5}, "in all"); }
TEST_F(InterlockTest, WhatIsNotANumberMeansZero) {
  expect_refused({0, std::nan(""), 0}, "coil 2");
  expect_refused({INFINITY, 0, 0}, "coil 1");
}

TEST_F(InterlockTest, AfterMakeSafeNothingPassesUntilItIsEnabled) {
  interlock.make_safe();
  EXPECT_THROW(interlock.set_currents(std::vector<double>{1, 0, 0}), DeviceError);
  EXPECT_EQ(amplifier.set, (std::vector<double>{0, 0, 0}));
  interlock.enable();
  EXPECT_EQ(amplifier.set, (std::vector<double>{0, 0, 0})) << "enabling energises nothing";
  interlock.set_currents(std::vector<double>{1, 0, 0});
  EXPECT_EQ(amplifier.set[0], 1);
}

TEST_F(InterlockTest, TheSmallerLimitHolds) {
  EXPECT_EQ(interlock.current_limit(), 5);
  Interlock wide(amplifier, {50, 100});
  EXPECT_EQ(wide.current_limit(), 10);
}

TEST(InterlockLimits, LimitsOfNothingAreRefused) {
  EXPECT_THROW((InterlockLimits{0, 10}.check()), std::invalid_argument);
  EXPECT_THROW((InterlockLimits{5, std::nan("")}.check()), std::invalid_argument);
}

}  // namespace
}  // namespace vitreo
