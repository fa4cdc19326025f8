// Interlock, by an amplifier that keeps every set-point it was ever given: a rule that acts one
// set-point too late is a pulse in the coils.
// SPDX-License-Identifier: Apache-2.0
#include "devices/time/error.h"
#include "host/safety/interlock.h"
#include "tests/host/safety/remembering_amplifier.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using Currents = std::vector<double>;

InterlockLimits limits() {
  InterlockLimits limits{5, 12};
  limits.slew = 100;
  return limits;
}

struct InterlockHistoryTest : testing::Test {
  void wait(double seconds) { clock->sleep_for(from_seconds(seconds)); }
  void set(const Currents& currents) { interlock.set_currents(currents); }
  void expect_refused(const Currents& currents, const std::string& why) {
    const std::size_t before = amplifier.told.size();
    try {
      set(currents);
      FAIL() << "taken: " << why;
    } catch (const DeviceError& error) {
      EXPECT_EQ(error.kind, DeviceErrorKind::refused);
      EXPECT_NE(std::string(error.what()).find(why), std::string::npos) << error.what();
    }
    for (std::size_t k = before; k < amplifier.told.size(); ++k)
      EXPECT_EQ(amplifier.told[k], (Currents{0, 0, 0})) << "a pulse";
    EXPECT_EQ(amplifier.now, (Currents{0, 0, 0}));
  }
  void begin_again() {
    interlock.enable();
    wait(0.1);
  }
  std::unique_ptr<Clock> clock = virtual_clock();
  RememberingAmplifier amplifier;
  Interlock interlock{amplifier, limits(), clock.get()};
};

TEST_F(InterlockHistoryTest, ARefusedSetPointNeverReachesTheAmplifier) {
  set({1, 1, 1});
  expect_refused({0, -5.01, 0}, "coil 2: -5.01 A is beyond the limit of 5 A");
  expect_refused({1, 0, 0}, "the interlock is open (coil 2: -5.01 A");
  expect_refused({0, 0, 0}, "rig.coils:enable() closes it again");
  begin_again();
  expect_refused({4.5, -4.5, 4.5}, "13.5 A in all are beyond the limit of 12 A");
  begin_again();
  expect_refused({0, std::nan(""), 0}, "coil 2");
  EXPECT_LE(amplifier.most(), 1);
}

TEST_F(InterlockHistoryTest, EachLimitHoldsToItsLastPercent) {
  set({5, -5, 2});
  EXPECT_EQ(amplifier.now, (Currents{5, -5, 2})) << "12 A in all are within 12 A";
  set({0, 0, 0});
  wait(1);
  expect_refused({5, 5, 2.05}, "in all");
  begin_again();
  for (std::size_t coil = 0; coil < 3; ++coil)
    for (const double sign : {1.0, -1.0}) {
      Currents beyond{0, 0, 0};
      beyond[coil] = sign * 5.02;
      expect_refused(beyond, "coil " + std::to_string(coil + 1));
      begin_again();
    }
}

TEST_F(InterlockHistoryTest, TheSlewHoldsForEachCoilInBothDirections) {
  for (std::size_t coil = 0; coil < 3; ++coil)
    for (const double sign : {1.0, -1.0}) {
      begin_again();
      Currents from{0, 0, 0};
      from[coil] = sign * 1;
      set(from);
      wait(0.01);
      Currents within = from;
      within[coil] = sign * 1.98;  // 98 A/s
      EXPECT_NO_THROW(set(within));
      wait(0.01);
      Currents beyond = within;
      beyond[coil] = sign * 3.08;  // 110 A/s
      expect_refused(beyond, "A/s");
    }
}

TEST_F(InterlockHistoryTest, TowardsZeroAnyRateIsLetAndThroughItNone) {
  set({-4, 4, -4});
  wait(0.001);
  EXPECT_NO_THROW(set({-1, 0, -4}));
  wait(0.001);
  expect_refused({1, 0, -4}, "coil 1: from -1 A to 1 A");
}

TEST_F(InterlockHistoryTest, AfterATripSlewAndHeatBeginFromZero) {
  set({5, 0, 0});
  wait(1);
  const double hot = interlock.temperatures()[0];
  interlock.trip("on purpose");
  const Time tripped = clock->now();
  interlock.enable();
  wait(0.03);
  // 3 A within 30 ms are 100 A/s from zero; from 5 A they would be towards zero.
  EXPECT_NO_THROW(set({0, 0, 0}));
  wait(0.01);
  expect_refused({2, 0, 0}, "from 0 A to 2 A");
  clock->sleep_until(tripped + std::chrono::seconds(60));
  EXPECT_LT(interlock.temperatures()[0], hot) << "no current has warmed it since";
}

TEST_F(InterlockHistoryTest, ACoilWarmsByTheClosedFormAndCoolsAgain) {
  InterlockLimits warm = limits();
  warm.heat.temperature_coefficient = 0;
  RememberingAmplifier own;
  Interlock one(own, warm, clock.get());
  one.set_currents(Currents{5, 0, -4});
  wait(100);
  // T - T0 = R I^2 R_th (1 - exp(-t / (C R_th))), R_th 0.5 K/W, C R_th 385 s.
  const double part = 1 - std::exp(-100.0 / 385);
  EXPECT_NEAR(one.temperatures()[0], 293.15 + 12.5 * part, 0.01);
  EXPECT_NEAR(one.temperatures()[1], 293.15, 1e-9);
  EXPECT_NEAR(one.temperatures()[2], 293.15 + 8 * part, 0.01);
}

TEST_F(InterlockHistoryTest, WarmCopperHasMoreResistance) {
  CoilHeat heat;
  CoilTemperature copper(heat, 1);
  heat.temperature_coefficient = 0;
  CoilTemperature constant(heat, 1);
  copper.advance(1e5, Currents{10});
  constant.advance(1e5, Currents{10});
  // In the end T - T0 = P / (1 - alpha P) with P = R0 I^2 R_th = 50 K, alpha 3.93e-3 1/K.
  EXPECT_NEAR(copper.hottest(), 293.15 + 50 / (1 - 3.93e-3 * 50), 0.05);
  EXPECT_NEAR(constant.hottest(), 293.15 + 50, 0.01);
}

TEST_F(InterlockHistoryTest, EveryLoopMustBeatNotTheFirstAlone) {
  for (const int silent : {0, 1, 2}) {
    interlock.enable();
    wait(1);
    std::vector<std::unique_ptr<Interlock::Heartbeat>> loops;
    for (const char* name : {"loop 0", "loop 1", "loop 2"})
      loops.push_back(std::make_unique<Interlock::Heartbeat>(interlock, name));
    set({1, 0, 0});
    const Time began = clock->now();
    while (interlock.enabled() && clock->now() - began < std::chrono::seconds(1)) {
      wait(0.01);
      for (int k = 0; k < 3; ++k)
        if (k != silent) loops[static_cast<std::size_t>(k)]->beat();
    }
    EXPECT_FALSE(interlock.enabled()) << silent;
    EXPECT_NE(interlock.tripped().find("loop " + std::to_string(silent)), std::string::npos)
        << interlock.tripped();
    const double after = to_seconds(clock->now() - began);
    EXPECT_GT(after, 0.25) << "not before the dead-man's time";
    EXPECT_LT(after, 0.311) << "and a turn of the watch after it at most";
    loops.clear();
  }
}

TEST_F(InterlockHistoryTest, EnablingLetsLoopsThatRestedBeatAnew) {
  Interlock::Heartbeat loop(interlock, "the loop");
  set({1, 0, 0});
  interlock.trip("on purpose");
  wait(3);
  interlock.enable();
  set({1, 0, 0});
  wait(0.06);
  EXPECT_TRUE(interlock.enabled()) << interlock.tripped();
}

TEST_F(InterlockHistoryTest, AZeroThatFailsOnItsWayDoesNotCountAsZero) {
  set({1, 1, 1});
  amplifier.gone = true;
  wait(0.01);
  EXPECT_THROW(set({0, 0, 0}), DeviceError);
  EXPECT_TRUE(interlock.energized());
  EXPECT_THROW(interlock.make_safe(), DeviceError);
  EXPECT_TRUE(interlock.energized());
  EXPECT_FALSE(interlock.enabled());
  amplifier.gone = false;
  wait(0.1);
  EXPECT_FALSE(interlock.energized()) << "sent again";
  EXPECT_EQ(amplifier.now, (Currents{0, 0, 0}));
}

TEST_F(InterlockHistoryTest, ACurrentThatFailsOnItsWayCountsAsFlowing) {
  amplifier.gone = true;
  EXPECT_THROW(set({1, 0, 0}), DeviceError);
  EXPECT_TRUE(interlock.energized()) << "it may have arrived";
}

TEST_F(InterlockHistoryTest, ARampGoesDownEvenlyToZero) {
  set({4, -2, 0});
  const std::size_t before = amplifier.told.size();
  const Time began = clock->now();
  interlock.pause(PausePolicy::ramp);
  EXPECT_NEAR(to_seconds(clock->now() - began), 0.5, 0.021);
  ASSERT_GE(amplifier.told.size(), before + 24);
  double last = 4;
  for (std::size_t k = before; k < amplifier.told.size(); ++k) {
    const Currents& one = amplifier.told[k];
    EXPECT_LE(one[0], last) << k;
    EXPECT_LT(last - one[0], 0.25) << "no step";
    EXPECT_NEAR(one[1], -one[0] / 2, 1e-12);
    last = one[0];
  }
  EXPECT_EQ(amplifier.told.back(), (Currents{0, 0, 0}));
  EXPECT_FALSE(interlock.energized());
}

TEST_F(InterlockHistoryTest, APauseAtOnceIsOneZeroAndAHeldOneNothing) {
  set({4, -2, 0});
  const std::size_t before = amplifier.told.size();
  interlock.pause(PausePolicy::hold);
  EXPECT_EQ(amplifier.told.size(), before);
  set({3, -2, 0});
  EXPECT_EQ(amplifier.now[0], 3) << "held: the loop goes on";
  interlock.pause(PausePolicy::zero);
  EXPECT_EQ(amplifier.told.back(), (Currents{0, 0, 0}));
  const std::size_t zero = amplifier.told.size();
  set({1, 0, 0});
  EXPECT_EQ(amplifier.told.size(), zero) << "dropped";
  interlock.resume();
  EXPECT_EQ(amplifier.told.size(), zero) << "and not queued";
  EXPECT_NO_THROW(set({4, 0, 0})) << "a first set-point after a rest may be a step";
}

TEST_F(InterlockHistoryTest, AResumeLooksAtEachCoilsReadingOfEitherSign) {
  for (const Currents& shown : {Currents{0.2, 0, 0}, {-0.2, 0, 0}, {0, 0, -0.2}}) {
    interlock.enable();
    wait(1);
    set({1, 0, 0});
    interlock.pause(PausePolicy::zero);
    amplifier.shown = shown;
    EXPECT_THROW(interlock.resume(), DeviceError);
    EXPECT_FALSE(interlock.enabled());
    amplifier.shown.clear();
    interlock.enable();
    interlock.resume();
  }
}

TEST_F(InterlockHistoryTest, TheUseIsOfWhatWasSent) {
  set({4, -1, 0});
  wait(2);
  set({-3, -1, 2});
  wait(1);
  set({0, 0, 0});
  wait(5);
  interlock.temperatures();  // brings the count up to now
  EXPECT_EQ(interlock.use().peak, (Currents{4, 1, 2}));
  EXPECT_EQ(interlock.use().peak_total, 6);
  EXPECT_NEAR(interlock.use().energized, 3, 1e-9);
  interlock.trip("one");
  interlock.trip("one");
  interlock.trip("two");
  EXPECT_EQ(interlock.use().trips, (std::vector<std::string>{"one", "two"}));
}

TEST_F(InterlockHistoryTest, ATripIsToldOnceAndWhatItIs) {
  std::vector<std::string> heard;
  interlock.on_trip([&](const Interlock::Trip& trip) {
    heard.push_back(trip.why + (trip.broken ? " (broken)" : ""));
    EXPECT_FALSE(interlock.energized()) << "at zero when it is told";
  });
  set({1, 0, 0});
  interlock.trip("on purpose");
  interlock.trip("on purpose");
  EXPECT_EQ(heard, (std::vector<std::string>{"on purpose"}));
}

TEST_F(InterlockHistoryTest, CurrentsThatAreNotSetAgainGoToZeroAfterTheirTime) {
  set({1, 0, 0});
  interlock.hold_for(std::chrono::seconds(2));
  wait(1.9);
  EXPECT_TRUE(interlock.enabled());
  set({1, 0, 0});
  interlock.hold_for(std::chrono::seconds(2));
  wait(1.99);
  EXPECT_EQ(amplifier.now[0], 1) << "set again";
  wait(0.12);
  EXPECT_EQ(amplifier.now[0], 0);
  EXPECT_EQ(interlock.tripped(),
            "dead-man: the currents were to be held for 2 s, and were not set again");
  interlock.enable();
  set({1, 0, 0});
  wait(10);
  EXPECT_TRUE(interlock.enabled()) << "a trip ends the hold";
}

TEST_F(InterlockHistoryTest, AHoldEndsWithAZeroAndRestsWhileALoopBeats) {
  set({1, 0, 0});
  interlock.hold_for(std::chrono::seconds(1));
  set({0, 0, 0});
  wait(0.1);
  set({2, 0, 0});
  wait(3);
  EXPECT_TRUE(interlock.enabled()) << interlock.tripped();
  interlock.hold_for(std::chrono::seconds(1));
  Interlock::Heartbeat loop(interlock, "the loop");
  for (int k = 0; k < 30; ++k) {
    wait(0.1);
    loop.beat();
  }
  EXPECT_TRUE(interlock.enabled()) << interlock.tripped();
}

TEST(InterlockLimitsOfEach, WhatGuardsNothingIsRefused) {
  RememberingAmplifier amplifier;
  const auto refused = [&](const std::function<void(InterlockLimits&)>& spoil) {
    InterlockLimits wrong = limits();
    spoil(wrong);
    try {
      const Interlock interlock(amplifier, wrong);
    } catch (const std::invalid_argument&) {
      return true;
    }
    return false;
  };
  const double nan = std::nan("");
  for (const double value : {0.0, -1.0, nan}) {
    EXPECT_TRUE(refused([&](InterlockLimits& one) { one.current = value; })) << value;
    EXPECT_TRUE(refused([&](InterlockLimits& one) { one.total_current = value; })) << value;
    EXPECT_TRUE(refused([&](InterlockLimits& one) { one.slew = value; })) << value;
    EXPECT_TRUE(refused([&](InterlockLimits& one) { one.read_back = value; })) << value;
    EXPECT_TRUE(refused([&](InterlockLimits& one) { one.heat.heat_capacity = value; })) << value;
    EXPECT_TRUE(refused([&](InterlockLimits& one) { one.heat.thermal_resistance = value; }));
    EXPECT_TRUE(refused([&](InterlockLimits& one) { one.heat.ambient = value; })) << value;
  }
  for (const double value : {0.049, 5.001, nan})
    EXPECT_TRUE(refused([&](InterlockLimits& one) { one.dead_man = value; })) << value;
  for (const double value : {0.05, 5.0})
    EXPECT_FALSE(refused([&](InterlockLimits& one) { one.dead_man = value; })) << value;
  for (const double value : {-0.1, nan}) {
    EXPECT_TRUE(refused([&](InterlockLimits& one) { one.heat.resistance = value; })) << value;
    EXPECT_TRUE(refused([&](InterlockLimits& one) { one.heat.temperature_coefficient = value; }));
  }
  EXPECT_FALSE(refused([&](InterlockLimits& one) { one.heat.resistance = 0; }));
  EXPECT_FALSE(refused([&](InterlockLimits& one) { one.heat.temperature_coefficient = 0; }));
  for (const double value : {293.15, 200.0, nan})
    EXPECT_TRUE(refused([&](InterlockLimits& one) { one.heat.limit = value; })) << value;
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
