// Interlock: rules that only a moment shows, or a second fault beside the first.
// SPDX-License-Identifier: Apache-2.0
#include "devices/time/error.h"
#include "host/safety/interlock.h"
#include "tests/host/safety/remembering_amplifier.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Currents = std::vector<double>;

InterlockLimits limits() {
  InterlockLimits limits{5, 12};
  limits.slew = 100;
  return limits;
}

struct InterlockRulesTest : testing::Test {
  void SetUp() override {
    interlock.on_trip([this](const Interlock::Trip& trip) { trips.push_back(trip.why); });
    interlock.on_rest([this](const CoilRest& rest) { rests.push_back(rest); });
    wait(3);  // what is measured from the clock's beginning alone shows
  }
  void wait(double seconds) { clock->sleep_for(from_seconds(seconds)); }
  void set(const Currents& currents) { interlock.set_currents(currents); }
  std::string refusal(const std::function<void()>& act) {
    try {
      act();
    } catch (const DeviceError& error) {
      return error.what();
    }
    return "";
  }
  std::unique_ptr<Clock> clock = virtual_clock();
  RememberingAmplifier amplifier;
  std::vector<std::string> trips;
  std::vector<CoilRest> rests;
  Interlock interlock{amplifier, limits(), clock.get()};
};

TEST_F(InterlockRulesTest, ATripSaysThatTheAmplifierDoesNotAnswer) {
  set({1, 0, 0});
  amplifier.gone = true;
  EXPECT_THROW(interlock.trip("on purpose"), DeviceError);
  ASSERT_EQ(trips.size(), 1U);
  EXPECT_EQ(trips[0].find("on purpose; and the amplifier does not answer: "), 0U) << trips[0];
  EXPECT_NE(refusal([this] { set({0, 0, 0}); }).find("does not answer"), std::string::npos);
}

TEST_F(InterlockRulesTest, AFirstCurrentThatFailsOnItsWayIsLookedAfterAllTheSame) {
  amplifier.measure = [this] { return amplifier.now; };
  amplifier.gone = true;
  EXPECT_THROW(set({2, 0, 0}), DeviceError);
  amplifier.gone = false;
  amplifier.now = {2, 0, 0};  // it had arrived
  wait(0.5);
  EXPECT_FALSE(interlock.enabled()) << "the watch was not awake";
  EXPECT_EQ(amplifier.now, (Currents{0, 0, 0}));
}

TEST_F(InterlockRulesTest, AnAmplifierThatIsGoneIsToldOnce) {
  set({1, 0, 0});
  amplifier.gone = true;
  EXPECT_THROW(interlock.trip("on purpose"), DeviceError);
  amplifier.links.hung_up = "the supply";
  wait(1);
  EXPECT_EQ(trips.size(), 1U) << trips.back();
}

TEST_F(InterlockRulesTest, ARestIsToldAlsoOfACurrentThatFlowedForNoTime) {
  set({1, 0, 0});
  const Time zeroed = clock->now();
  interlock.make_safe();
  interlock.make_safe();  // as a stop and the end of the run do
  wait(1);
  ASSERT_EQ(rests.size(), 1U);
  EXPECT_FALSE(rests[0].measured) << "no read-back";
  EXPECT_EQ(rests[0].at, zeroed);
}

TEST_F(InterlockRulesTest, ARestIsReadUntilItIsOne) {
  const Time zeroed = clock->now();
  amplifier.measure = [&] { return Currents{0, clock->now() - zeroed < 290ms ? 1.0 : 0, 0}; };
  set({0, 1, 0});
  wait(0.1);
  interlock.make_safe();
  wait(1);
  ASSERT_EQ(rests.size(), 1U);
  EXPECT_TRUE(at_zero(rests[0])) << "half a second is left to a current that falls";
  EXPECT_GE(rests[0].at, zeroed + 290ms);
  amplifier.measure = [] { return Currents{0, 1, 0}; };
  const Time began = clock->now();
  EXPECT_FALSE(at_zero(interlock.read_rest()));
  EXPECT_NEAR(to_seconds(clock->now() - began), 0.5, 0.03) << "and no more";
}

TEST_F(InterlockRulesTest, NoRestIsToldOfCoilsThatCarryACurrentAgain) {
  amplifier.measure = [this] { return amplifier.now; };
  set({1, 0, 0});
  wait(0.1);
  const Time zeroed = clock->now();
  interlock.make_safe();
  amplifier.measure = [&] {
    return clock->now() - zeroed < 200ms ? Currents{1, 0, 0} : amplifier.now;
  };
  wait(0.1);
  interlock.enable();
  set({1, 0, 0});
  wait(1);
  EXPECT_TRUE(rests.empty());
}

TEST_F(InterlockRulesTest, WhatWasReadIsTheAnswerThoughTheZeroFailed) {
  amplifier.measure = [] { return Currents{0, 0, 0}; };
  set({1, 0, 0});
  amplifier.gone = true;
  EXPECT_THROW(interlock.make_safe(), DeviceError);
  const CoilRest rest = interlock.read_rest();
  EXPECT_EQ(rest.failure, "");
  EXPECT_TRUE(at_zero(rest));
  amplifier.measure = nullptr;
  EXPECT_EQ(interlock.read_rest().failure, "the amplifier did not take the zero");
}

TEST(InterlockWithoutAClock, ReadsItsRestOnceAndLimitsNoSlew) {
  RememberingAmplifier amplifier;
  amplifier.measure = [] { return Currents{0, 0.7, 0}; };
  Interlock interlock(amplifier, limits());
  EXPECT_EQ(interlock.reachable(Currents{5, -5, 1}), (Currents{5, -5, 1}));
  interlock.set_currents(Currents{5, -5, 1});
  interlock.make_safe();
  EXPECT_EQ(interlock.read_rest().measured, (Currents{0, 0.7, 0}));
  EXPECT_EQ(amplifier.asked, 1);
  interlock.enable();
  interlock.set_currents(Currents{1, 0, 0});
  interlock.pause(PausePolicy::ramp);
  EXPECT_EQ(amplifier.now, (Currents{0, 0, 0}));
  EXPECT_TRUE(interlock.temperatures().empty());
  interlock.enable();
  EXPECT_NO_THROW(interlock.near(Interlock::Nearness{"retina", 0.1e-3, 0.2e-3, 0.3e-3}));
  amplifier.measure = []() -> Currents {
    throw DeviceError(DeviceErrorKind::lost, "coils", "is gone");
  };
  EXPECT_NE(interlock.read_rest().failure.find("is gone"), std::string::npos);
}

TEST_F(InterlockRulesTest, ALimitThatWasComputedIsNotPassedByRounding) {
  EXPECT_NO_THROW(set({5 * (1 + 1e-12), 0, 0}));
  EXPECT_THROW(set({5 * (1 + 1e-6), 0, 0}), DeviceError);
}

TEST_F(InterlockRulesTest, WhatIsReachableIsTakenWhateverItIs) {
  std::uint32_t random = 1;
  const auto draw = [&random] {
    random = random * 1664525U + 1013904223U;
    return 8.0 * random / 4294967296.0 - 4;
  };
  for (int k = 0; k < 2000; ++k) {
    wait(0.0071);
    ASSERT_NO_THROW(set(interlock.reachable(Currents{draw(), draw(), draw()}))) << k;
  }
  EXPECT_EQ(interlock.reachable(Currents{1, 2}), (Currents{1, 2})) << "the amplifier refuses it";
  EXPECT_THROW(set({1, 1, 1, 1}), std::invalid_argument);
}

TEST_F(InterlockRulesTest, ConditionsAreAskedByTheWatchWhileACurrentFlows) {
  int asked = 0;
  interlock.require("the pedal is released", [&] { return ++asked > 0; });
  set({1, 0, 0});
  EXPECT_EQ(asked, 1);
  for (int k = 0; k < 100; ++k) {
    wait(0.01);
    set({1, 0, 0});
  }
  EXPECT_NEAR(asked, 21, 2);
}

TEST_F(InterlockRulesTest, AfterEnablingAStepMayFollowAtOnce) {
  InterlockLimits slow = limits();
  slow.slew = 3;
  RememberingAmplifier own;
  Interlock one(own, slow, clock.get());
  one.set_currents(Currents{2.9, 0, 0});
  one.make_safe();
  one.enable();
  EXPECT_NO_THROW(one.set_currents(Currents{2.9, 0, 0}));
}

TEST_F(InterlockRulesTest, AZeroPauseIsOneSetPointAndARampLeavesOffWhereItOpens) {
  set({4, 0, 0});
  std::size_t before = amplifier.told.size();
  interlock.pause(PausePolicy::zero);
  EXPECT_EQ(amplifier.told.size(), before + 1);
  interlock.resume();
  set({4, 0, 0});
  before = amplifier.told.size();
  interlock.pause(PausePolicy::ramp);
  EXPECT_EQ(amplifier.told.size(), before + 26) << "25 steps of 20 ms, and the zero";
  interlock.resume();
  set({4, 0, 0});
  const auto other = clock->spawn("operator", [this] {
    wait(0.1);
    interlock.make_safe();
  });
  const Time began = clock->now();
  interlock.pause(PausePolicy::ramp);
  EXPECT_LT(to_seconds(clock->now() - began), 0.13);
}

TEST_F(InterlockRulesTest, ACurrentThatComesBackThroughZeroIsNoContradiction) {
  Time zeroed = -1s;
  amplifier.measure = [&] {
    return clock->now() - zeroed < 60ms ? Currents{0.5, 0, 0} : amplifier.now;
  };
  set({4, 0, 0});
  wait(1);
  interlock.make_safe();
  zeroed = clock->now();
  interlock.enable();
  set({4, 0, 0});
  wait(1);
  EXPECT_TRUE(interlock.enabled()) << interlock.tripped();
}

TEST_F(InterlockRulesTest, AHeldCurrentIsAskedForTenTimesASecond) {
  amplifier.measure = [this] { return amplifier.now; };
  set({1, 2, 3});
  wait(1);
  const int before = amplifier.asked;
  wait(2);
  EXPECT_NEAR(amplifier.asked - before, 20, 2);
}

TEST_F(InterlockRulesTest, NothingWarmsAfterAZeroAndWhatDidCounts) {
  set({0, 5, 0});
  wait(0.04);  // less than a turn of the watch
  interlock.make_safe();
  const double warm = interlock.temperatures()[1];
  EXPECT_GT(warm, 293.15 + 1e-4);
  EXPECT_NEAR(interlock.use().energized, 0.04, 1e-9);
  wait(30);
  EXPECT_LT(interlock.temperatures()[1], warm);
  EXPECT_NEAR(interlock.use().energized, 0.04, 1e-9);
}

TEST_F(InterlockRulesTest, ACoilThatIsTooHotIsToldInDegreesCelsius) {
  InterlockLimits hot = limits();
  hot.heat.limit = 296.15;
  RememberingAmplifier own;
  Interlock one(own, hot, clock.get());
  one.set_currents(Currents{5, 0, 0});
  wait(300);
  EXPECT_EQ(one.tripped(),
            "a coil is at 23 \u00b0C by the estimate from its currents, beyond the limit of 23 "
            "\u00b0C");
}

TEST_F(InterlockRulesTest, ASetPointAloneDoesNotProlongAHold) {
  set({1, 0, 0});
  interlock.hold_for(1s);
  wait(0.9);
  set({2, 0, 0});
  wait(0.2);
  EXPECT_FALSE(interlock.enabled());
  ASSERT_EQ(trips.size(), 1U);
  EXPECT_EQ(trips[0], "dead-man: the currents were to be held for 1 s, and were not set again");
}

TEST_F(InterlockRulesTest, APushIsToldByItsNumbersAndThenCountsAnew) {
  const Interlock::Nearness pushed{"retina", 0.1e-3, 0.2e-3, 0.3e-3};
  const auto push = [&] {
    interlock.enable();
    const Time began = clock->now();
    std::string said;
    while (said.empty() && clock->now() - began < 3s) {
      wait(0.05);
      said = refusal([&] { interlock.near(pushed); });
    }
    EXPECT_NEAR(to_seconds(clock->now() - began), 1.05, 0.001);
    return said;
  };
  EXPECT_NE(push().find("keep-out margin: the robot is pushed against the retina at 0.30 mm/s, "
                        "0.10 mm from it or less, where 0.20 mm must be left"),
            std::string::npos);
  EXPECT_NE(push(), "") << "a second of pushing again";
}

TEST_F(InterlockRulesTest, ARampTakesHalfASecondAtAnyTime) {
  wait(100);
  set({4, 0, 0});
  const Time began = clock->now();
  const std::size_t before = amplifier.told.size();
  interlock.pause(PausePolicy::ramp);
  EXPECT_NEAR(to_seconds(clock->now() - began), 0.5, 0.021);
  double last = 4;
  for (std::size_t k = before; k < amplifier.told.size(); ++k) {
    EXPECT_LT(last - amplifier.told[k][0], 0.25) << "no step";
    last = amplifier.told[k][0];
  }
}

TEST_F(InterlockRulesTest, AfterARestTheSlewCountsFromASecondAgo) {
  InterlockLimits slow = limits();
  slow.slew = 3;
  RememberingAmplifier own;
  Interlock one(own, slow, clock.get());
  EXPECT_NO_THROW(one.set_currents(Currents{3, 0, 0})) << "the limit itself";
  one.make_safe();
  one.enable();
  EXPECT_THROW(one.set_currents(Currents{3.1, 0, 0}), DeviceError);
}

TEST_F(InterlockRulesTest, AResumeNamesTheCoilThatCarriesACurrent) {
  set({1, 0, 0});
  interlock.pause(PausePolicy::zero);
  amplifier.shown = {0, -0.2, 0};
  EXPECT_NE(
      refusal([this] { interlock.resume(); }).find("coil 2 carries -0.2 A after a pause at zero"),
      std::string::npos);
}

TEST(InterlockLimitsOfLessThanOne, ArePossible) {
  EXPECT_NO_THROW((InterlockLimits{0.5, 0.7}.check()));
  InterlockLimits slow{0.5, 0.7};
  slow.slew = 0.5;
  slow.read_back = 0.02;
  EXPECT_NO_THROW(slow.check());
  slow.heat.limit = 200;  // K, below ambient
  EXPECT_THROW(slow.check(), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
