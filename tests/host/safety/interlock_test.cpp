// Interlock: it refuses what is beyond its limits, and a refusal means zero.
// SPDX-License-Identifier: Apache-2.0
#include "host/safety/interlock.h"

#include "devices/time/error.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <memory>
#include <optional>
#include <string>

namespace vitreo {
namespace VITREO_TEST_FILE {

class FakeAmplifier : public CoilAmplifier {
 public:
  std::string identity() const override { return "fake"; }
  int channels() const override { return 3; }
  double current_limit() const override { return 10; }
  void set_currents(std::span<const double> currents) override {
    set.assign(currents.begin(), currents.end());
  }
  std::vector<double> currents() const override { return set; }
  LinkState link_state() const override { return links; }
  std::optional<std::vector<double>> measured_currents() override {
    ++asked;
    return measure ? measure(set) : std::nullopt;
  }
  void make_safe() override {
    set.assign(3, 0);
    ++made_safe;
  }
  /// What flows for what is set; without it nothing is measured.
  std::function<std::optional<std::vector<double>>(const std::vector<double>&)> measure;
  int asked = 0;
  LinkState links;
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
  EXPECT_EQ(amplifier.set, (std::vector<double>{0, 0, 0})) << "enabling energizes nothing";
  interlock.set_currents(std::vector<double>{1, 0, 0});
  EXPECT_EQ(amplifier.set[0], 1);
}

TEST_F(InterlockTest, TheSmallerLimitHolds) {
  EXPECT_EQ(interlock.current_limit(), 5);
  Interlock wide(amplifier, {50, 100});
  EXPECT_EQ(wide.current_limit(), 10);
}

/// With a clock, the rules of time hold as well.
struct TimedInterlockTest : testing::Test {
  static InterlockLimits limits() {
    InterlockLimits limits{10, 30};
    limits.slew = 100;
    return limits;
  }
  std::unique_ptr<Clock> clock = virtual_clock();
  FakeAmplifier amplifier;
  std::string told;
  bool broken = false;
  Interlock interlock{amplifier, limits(), clock.get()};
  void SetUp() override {
    interlock.on_trip([this](const Interlock::Trip& trip) {
      told += trip.why + ";";
      broken = broken || trip.broken;
    });
    clock->sleep_for(from_seconds(1));
  }
};

TEST_F(TimedInterlockTest, AChangeThatIsTooFastMeansZeroButTowardsZeroNoneIs) {
  interlock.set_currents(std::vector<double>{5, 0, 0});
  clock->sleep_for(from_seconds(0.01));
  interlock.set_currents(std::vector<double>{0, 0, 0});
  clock->sleep_for(from_seconds(0.01));
  interlock.set_currents(std::vector<double>{0, 0.9, 0});
  clock->sleep_for(from_seconds(0.01));
  EXPECT_THROW(interlock.set_currents(std::vector<double>{0, 3, 0}), DeviceError);
  EXPECT_EQ(amplifier.set, (std::vector<double>{0, 0, 0}));
  EXPECT_EQ(told, "coil 2: from 0.9 A to 3 A within 10 ms is beyond the limit of 100 A/s;");
}

// As two frames in one burst ask for it: the rest comes with the next step.
TEST_F(TimedInterlockTest, WhatIsReachableNowPassesAndTheRestLater) {
  interlock.set_currents(std::vector<double>{5, 1, -1});
  clock->sleep_for(from_seconds(0.01));
  const std::vector<double> wanted{-4, 3, 0};
  const std::vector<double> first = interlock.reachable(wanted);
  EXPECT_NEAR(first[0], 4, 1e-6) << "100 A/s for 10 ms";
  EXPECT_NEAR(first[1], 2, 1e-6);
  EXPECT_EQ(first[2], 0) << "towards zero at any rate";
  EXPECT_NO_THROW(interlock.set_currents(first));
  clock->sleep_for(from_seconds(0.1));
  EXPECT_EQ(interlock.reachable(wanted), wanted);
  EXPECT_NO_THROW(interlock.set_currents(wanted));
}

TEST_F(TimedInterlockTest, ThroughZeroIsNotTowardsZero) {
  interlock.set_currents(std::vector<double>{5, 0, 0});
  clock->sleep_for(from_seconds(0.01));
  EXPECT_THROW(interlock.set_currents(std::vector<double>{-4, 0, 0}), DeviceError);
  EXPECT_EQ(amplifier.set, (std::vector<double>{0, 0, 0}));
  EXPECT_EQ(told, "coil 1: from 5 A to -4 A within 10 ms is beyond the limit of 100 A/s;");
}

TEST_F(TimedInterlockTest,
       ALoopThatTakesOverCoilsAtRestMayBeginWithAStepAndOneThatTakesOverCurrentsMayNot) {
  const std::vector<double> nothing(3, 0.0), step{4, 0, 0};
  {
    Interlock::Heartbeat heart(interlock, "the loop before");
    interlock.set_currents(step);
    interlock.set_currents(nothing);
  }
  {
    Interlock::Heartbeat heart(interlock, "the next loop, at once");
    EXPECT_NO_THROW(interlock.set_currents(step));
  }
  Interlock::Heartbeat heart(interlock, "a loop beside another");
  EXPECT_THROW(interlock.set_currents(std::vector<double>{4.5, 0, 0}), DeviceError);
}

TEST_F(TimedInterlockTest, AHeartThatStopsBeatingMeansZeroWithinTheDeadMansTime) {
  {
    Interlock::Heartbeat heart(interlock, "the loop");
    interlock.set_currents(std::vector<double>{5, 0, 0});
    for (int i = 0; i < 20; ++i) {
      clock->sleep_for(from_seconds(0.1));
      heart.beat();
    }
    EXPECT_EQ(amplifier.set[0], 5) << "it beats";
    clock->sleep_for(from_seconds(0.24));
    EXPECT_EQ(amplifier.set[0], 5);
    clock->sleep_for(from_seconds(0.07));
    EXPECT_EQ(amplifier.set[0], 0);
  }
  EXPECT_EQ(told, "dead-man: the loop has not moved for 300 ms;") << told;
  try {
    interlock.set_currents(std::vector<double>{1, 0, 0});
    FAIL() << "taken";
  } catch (const DeviceError& error) {
    EXPECT_NE(std::string(error.what()).find("dead-man"), std::string::npos) << error.what();
  }
  interlock.enable();
  interlock.set_currents(std::vector<double>{1, 0, 0});
  EXPECT_EQ(amplifier.set[0], 1);
}

TEST_F(TimedInterlockTest, ACurrentFlowsOnlyWhileThePedalIsHeld) {
  bool held = false;
  interlock.require("the pedal is released, or gone", [&] { return held; });
  EXPECT_NO_THROW(interlock.set_currents(std::vector<double>{0, 0, 0}));
  clock->sleep_for(from_seconds(0.1));
  EXPECT_THROW(interlock.set_currents(std::vector<double>{1, 0, 0}), DeviceError);
  EXPECT_EQ(amplifier.set, (std::vector<double>{0, 0, 0}));
  EXPECT_EQ(told, "dead-man: the pedal is released, or gone;");
  told.clear();
  held = true;
  interlock.enable();
  clock->sleep_for(from_seconds(0.1));
  interlock.set_currents(std::vector<double>{1, 0, 0});
  clock->sleep_for(from_seconds(10));
  EXPECT_EQ(amplifier.set[0], 1) << "it is held";
  held = false;
  clock->sleep_for(from_seconds(0.06));
  EXPECT_EQ(amplifier.set[0], 0);
  EXPECT_EQ(told, "dead-man: the pedal is released, or gone;");
}

TEST_F(TimedInterlockTest, AHeartMattersOnlyWhileTheCoilsAreEnergized) {
  const Interlock::Heartbeat heart(interlock, "the loop");
  clock->sleep_for(from_seconds(10));
  EXPECT_TRUE(interlock.enabled());
  EXPECT_EQ(told, "");
}

/// Takes its time over a set-point, and refuses so many zeros.
class SlowAmplifier : public FakeAmplifier {
 public:
  explicit SlowAmplifier(Clock& clock) : clock_(clock) {}
  void set_currents(std::span<const double> currents) override {
    clock_.sleep_for(from_seconds(0.01));
    FakeAmplifier::set_currents(currents);
  }
  void make_safe() override {
    if (refusals-- > 0) throw DeviceError(DeviceErrorKind::lost, "coils", "is gone");
    FakeAmplifier::make_safe();
  }
  int refusals = 0;

 private:
  Clock& clock_;
};

TEST_F(TimedInterlockTest, ASetPointThatWasOnItsWayWhenItOpenedIsTakenBack) {
  SlowAmplifier slow(*clock);
  Interlock own(slow, limits(), clock.get());
  const auto other = clock->spawn("other", [&] {
    clock->sleep_for(from_seconds(0.005));
    own.trip("on purpose");
  });
  try {
    own.set_currents(std::vector<double>{1, 1, 1});
    FAIL() << "taken";
  } catch (const DeviceError& error) {
    EXPECT_NE(std::string(error.what()).find("on purpose"), std::string::npos) << error.what();
  }
  EXPECT_EQ(slow.set, (std::vector<double>{0, 0, 0}));
  EXPECT_FALSE(own.energized());
}

TEST_F(TimedInterlockTest, AZeroThatDidNotGetThroughIsSentAgainUntilItDoes) {
  SlowAmplifier slow(*clock);
  Interlock own(slow, limits(), clock.get());
  own.set_currents(std::vector<double>{1, 1, 1});
  slow.refusals = 3;
  EXPECT_THROW(own.trip("on purpose"), DeviceError);
  EXPECT_TRUE(own.energized());
  clock->sleep_for(from_seconds(0.3));
  EXPECT_EQ(slow.set, (std::vector<double>{0, 0, 0}));
  EXPECT_FALSE(own.energized());
}

TEST_F(TimedInterlockTest, ACoilThatGetsTooHotMeansZeroAtTheTimeThatTheClosedFormSays) {
  // At constant resistance: T - T_a = R I^2 R_th (1 - exp(-t / tau)); alpha = 0 here.
  InterlockLimits hot = limits();
  hot.heat.temperature_coefficient = 0;
  hot.heat.limit = hot.heat.ambient + 30;
  Interlock own(amplifier, hot, clock.get());
  clock->sleep_for(from_seconds(1));
  const double began = to_seconds(clock->now());
  own.set_currents(std::vector<double>{0, 10, 0});
  while (own.enabled() && to_seconds(clock->now()) < 2000) clock->sleep_for(from_seconds(0.1));
  const double rise = 1.0 * 100 * 0.5, tau = 770 * 0.5;
  EXPECT_NEAR(to_seconds(clock->now()) - began, -tau * std::log(1 - 30 / rise), 0.3) << "s";
  EXPECT_NEAR(own.temperatures()[1], hot.heat.limit, 0.05) << "K";
  EXPECT_NEAR(own.temperatures()[0], hot.heat.ambient, 1e-9);
}

TEST_F(TimedInterlockTest, APauseAtZeroDropsSetPointsAndTheResumeEnergizesNothing) {
  interlock.set_currents(std::vector<double>{4, 0, 0});
  interlock.pause(PausePolicy::ramp);
  EXPECT_EQ(amplifier.set[0], 0);
  interlock.set_currents(std::vector<double>{4, 0, 0});
  EXPECT_EQ(amplifier.set[0], 0) << "dropped, not queued";
  interlock.resume();
  EXPECT_EQ(amplifier.set[0], 0);
  clock->sleep_for(from_seconds(0.1));
  interlock.set_currents(std::vector<double>{4, 0, 0});
  EXPECT_EQ(amplifier.set[0], 4);
}

TEST_F(TimedInterlockTest, AResumeIsRefusedWhereTheAmplifierReadsSomethingElse) {
  interlock.set_currents(std::vector<double>{4, 0, 0});
  interlock.pause(PausePolicy::zero);
  amplifier.set[0] = 4;  // a knob was turned by hand
  EXPECT_THROW(interlock.resume(), DeviceError);
  EXPECT_EQ(amplifier.set[0], 0);
  EXPECT_FALSE(interlock.enabled());
}

TEST_F(TimedInterlockTest, NoSetPointOfAPausedLoopIsBeyondTheLimitsUnnoticed) {
  interlock.pause(PausePolicy::zero);
  EXPECT_THROW(interlock.set_currents(std::vector<double>{99, 0, 0}), DeviceError);
}

/// Half a millimeter from the retina or less, where the margin is 0.2 mm.
Interlock::Nearness near_retina(double bound, double push) {
  return {"retina", bound, 0.2e-3, push};
}

TEST_F(TimedInterlockTest, APushAgainstAWallInsideTheMarginMeansZeroAfterASecond) {
  interlock.set_currents(std::vector<double>{1, 0, 0});
  for (int k = 0; k < 19; ++k) {
    interlock.near(near_retina(0.1e-3, 0.3e-3));
    interlock.set_currents(std::vector<double>{1, 0, 0});
    clock->sleep_for(from_seconds(0.05));
  }
  EXPECT_TRUE(interlock.enabled()) << "a disturbance may take as long to be corrected";
  clock->sleep_for(from_seconds(0.1));
  EXPECT_THROW(interlock.near(near_retina(0.1e-3, 0.3e-3)), DeviceError);
  EXPECT_FALSE(interlock.enabled());
  EXPECT_EQ(amplifier.set, (std::vector<double>{0, 0, 0}));
  EXPECT_NE(told.find("pushed against the retina"), std::string::npos) << told;
  EXPECT_THROW(interlock.set_currents(std::vector<double>{1, 0, 0}), DeviceError) << "refused";
}

TEST_F(TimedInterlockTest, WhatCarriesTheRobotOrGetsItAwayOrKeepsTheMarginIsLet) {
  interlock.set_currents(std::vector<double>{1, 0, 0});
  for (int k = 0; k < 100; ++k) {
    interlock.near(near_retina(0.1e-3, -0.5e-3));  // lifted
    clock->sleep_for(from_seconds(0.05));
  }
  for (int k = 0; k < 100; ++k) {
    interlock.near(near_retina(0.05e-3 + 1e-6 * k, 0.3e-3));  // 20 um/s, against a current
    clock->sleep_for(from_seconds(0.05));
  }
  for (int k = 0; k < 100; ++k) {
    interlock.near(near_retina(0.19e-3, 0.3e-3));
    clock->sleep_for(from_seconds(0.05));
  }
  interlock.near(std::nullopt);
  EXPECT_TRUE(interlock.enabled());
}

TEST(InterlockLimits, LimitsOfNothingAreRefused) {
  EXPECT_THROW((InterlockLimits{0, 10}.check()), std::invalid_argument);
  EXPECT_THROW((InterlockLimits{5, std::nan("")}.check()), std::invalid_argument);
}

/// Of what is held without any further set-point: nothing but the interlock's own questions can
/// notice.
struct HeldCurrentTest : TimedInterlockTest {
  using Flows = std::vector<double>;
  void hold(const Flows& currents) {
    interlock.set_currents(currents);
    clock->sleep_for(from_seconds(10));
    EXPECT_EQ(told, "") << "a current as it was set";
  }
  /// s from now until it trips, at most 1.
  double noticed_after() {
    const Time began = clock->now();
    while (told.empty() && clock->now() - began < std::chrono::seconds(1))
      clock->sleep_for(std::chrono::milliseconds(1));
    return to_seconds(clock->now() - began);
  }
  void expect_noticed(std::function<std::optional<Flows>(const Flows&)> flows,
                      const std::string& said) {
    // 50 moments between two questions.
    for (int trial = 0; trial < 50; ++trial) {
      told.clear();
      broken = false;
      amplifier.measure = [](const Flows& set) { return set; };
      interlock.enable();
      hold({4, -3, 1});
      clock->sleep_for(from_seconds(0.0031 * trial));
      amplifier.measure = flows;
      EXPECT_LT(noticed_after(), 0.5) << trial;
      EXPECT_NE(told.find(said), std::string::npos) << told;
      EXPECT_TRUE(broken);
      EXPECT_EQ(amplifier.set, (Flows{0, 0, 0}));
    }
  }
};

TEST_F(HeldCurrentTest, ASupplyThatIsGoneIsNoticed) {
  expect_noticed(
      [](const Flows&) -> std::optional<Flows> {
        throw DeviceError(DeviceErrorKind::lost, "coils", "the cable is out");
      },
      "does not answer while a current is held");
}

// By listening: the next question would come up to 150 ms later.
TEST_F(HeldCurrentTest, ALinkThatHangsUpIsNoticedWithinAFewMilliseconds) {
  amplifier.measure = [](const Flows& set) { return set; };
  for (int trial = 0; trial < 50; ++trial) {
    told.clear();
    amplifier.links = {};
    interlock.enable();
    hold({4, -3, 1});
    clock->sleep_for(from_seconds(0.0031 * trial));
    const int asked = amplifier.asked;
    amplifier.links.hung_up = "channel 2, tcp:10.0.0.12:5025";
    EXPECT_LE(noticed_after(), 0.006) << trial;
    EXPECT_EQ(told,
              "channel 2, tcp:10.0.0.12:5025 has hung up: its cable is out, or it has lost its "
              "power;")
        << "once, and which";
    EXPECT_TRUE(broken);
    EXPECT_EQ(amplifier.asked, asked) << "nothing was asked";
    EXPECT_EQ(amplifier.set, (Flows{0, 0, 0}));
  }
}

TEST_F(HeldCurrentTest, ALinkThatHangsUpWithoutACurrentIsNoTrip) {
  amplifier.links.hung_up = "its link";
  clock->sleep_for(from_seconds(1));
  EXPECT_EQ(told, "");
}

TEST_F(HeldCurrentTest, ASupplyAtZeroIsNoticed) {
  expect_noticed([](const Flows& set) { return Flows{set[0], 0, set[2]}; }, "coil 2: 0 A flow");
}

TEST_F(HeldCurrentTest, AReversedSupplyIsNoticed) {
  expect_noticed(
      [](const Flows& set) {
        return Flows{-set[0], set[1], set[2]};
      },
      "coil 1: -4 A flow where 4 A were set");
}

TEST_F(HeldCurrentTest, TwoSwappedSuppliesAreNoticed) {
  expect_noticed([](const Flows& set) { return Flows{set[1], set[0], set[2]}; }, "coil 1: -3 A");
}

// A loop's own set-points are exchanges with the amplifier; the question would only be in their
// way.
TEST_F(HeldCurrentTest, ALoopThatSetsCurrentsIsNotDisturbedByQuestions) {
  for (int step = 0; step < 100; ++step) {
    interlock.set_currents(Flows{1 + 0.01 * step, 0, 0});
    clock->sleep_for(from_seconds(0.066));
  }
  EXPECT_EQ(amplifier.asked, 0);
}

// Of an amplifier that lags by 0.1 s: between two set-points far apart any current between them is
// as it should be.
TEST_F(HeldCurrentTest, ACurrentOnItsWayToItsSetPointIsNoContradiction) {
  Flows before{0, 0, 0}, now{0, 0, 0};
  Time changed{};
  amplifier.measure = [&](const Flows&) {
    Flows flows(3);
    const double part = std::min(1.0, to_seconds(clock->now() - changed) / 0.1);
    for (std::size_t i = 0; i < 3; ++i) flows[i] = before[i] + part * (now[i] - before[i]);
    return flows;
  };
  for (int step = 1; step < 200; ++step) {
    before = now;
    now = {step % 2 == 0 ? 5. : -5., 0.02 * step, 0};
    changed = clock->now();
    interlock.set_currents(now);
    clock->sleep_for(from_seconds(0.11 + 0.0013 * step));
  }
  EXPECT_EQ(told, "");
  EXPECT_GT(amplifier.asked, 100);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
