// The law estimator on machines that are not its model: single mistakes and worst corners, the
// filter's own claims, and a dead coil. Fewer machines than the benchmark's, and other seeds.
// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/machines/identified_machine.h"
#include "tests/bench/machines/machine_loop.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace vitreo::machines {
namespace VITREO_TEST_FILE {

constexpr std::uint64_t kFirst = 7001;  // seeds that nothing was tuned on
constexpr int kMachines = 6;

const control::Trajectory& hold() {
  static const control::Trajectory path = control::Trajectory::hold_at({2e-3, 0, 1e-3});
  return path;
}

const control::Trajectory& square() {
  static const control::Trajectory path =
      control::Trajectory::rectangle({-4e-3, 0, -3e-3}, {8e-3, 0, 0}, {0, 0, 6e-3}, {});
  return path;
}

MachineResult held(MachineSetting setting, Law law = Law::now) {
  return run_machine(setting, law, hold(), 8, 10);
}

class Mistaken : public testing::TestWithParam<Mistake> {};

// The goal of every single error and of the worst corners, machine by machine.
TEST_P(Mistaken, IsHeldWithinFiveMicrometersAndNeverWorseThanByTheThesisLaw) {
  for (int k = 0; k < kMachines; ++k) {
    MachineSetting setting;
    setting.mistake = GetParam();
    setting.seed = kFirst + static_cast<std::uint64_t>(k);
    const MachineResult one = held(setting);
    EXPECT_EQ(one.failure, "");
    EXPECT_LT(one.rms, 5e-6) << "seed " << setting.seed;
    const MachineResult pd = held(setting, Law::pd);
    EXPECT_TRUE(!pd.failure.empty() || one.rms < pd.rms) << "seed " << setting.seed;
  }
}

INSTANTIATE_TEST_SUITE_P(Machines, Mistaken,
                         testing::Values(Mistake{"nominal"}, Mistake{"sooner", -50e-3},
                                         Mistake{"later", 60e-3}, Mistake{"thin", 0, 0.5},
                                         Mistake{"thick", 0, 2}, Mistake{"weak", 0, 1, 0.7},
                                         Mistake{"strong", 0, 1, 1.3},
                                         Mistake{"heavy", 0, 1, 1, 1.5},
                                         Mistake{"worst_slow", 60e-3, 2, 0.7, 1.5},
                                         Mistake{"worst_fast", 60e-3, 0.5, 1.3, 1.5}),
                         [](const auto& one) { return one.param.name; });

// What made the law before oscillate: the test above can fail.
TEST(Machines, TheLawBeforeOscillatesWhereTheDragIsHalfOfTheBelieved) {
  int oscillating = 0;
  for (int k = 0; k < kMachines; ++k) {
    MachineSetting setting;
    setting.mistake = {"thin", 0, 0.5};
    setting.seed = kFirst + static_cast<std::uint64_t>(k);
    oscillating += held(setting, Law::before).rms > 50e-6 ? 1 : 0;
  }
  EXPECT_GE(oscillating, kMachines / 2);
}

TEST(Machines, GoRoundTheSquareWithinTwelveMicrometersAndTheFilterIsAsSureAsItIsRight) {
  std::vector<double> errors;
  for (int k = 0; k < kMachines; ++k) {
    MachineSetting setting;
    setting.seed = kFirst + static_cast<std::uint64_t>(k);
    const MachineResult one = run_machine(setting, Law::now, square(), 8, 0);
    EXPECT_EQ(one.failure, "");
    EXPECT_LT(one.rms, 12e-6) << "seed " << setting.seed;
    errors.push_back(one.rms);
    // 420 steps, correlated over a few: 0.5 to 1.5 is far outside of chance, and what a filter with
    // a standard deviation wrong by a fifth would be at.
    EXPECT_GT(one.consistency, 0.5);
    EXPECT_LT(one.consistency, 1.5);
    EXPECT_NEAR(one.innovation, 1, 0.3);
    EXPECT_NEAR(one.correlation, 0, 0.25);
  }
  std::nth_element(errors.begin(), errors.begin() + kMachines / 2, errors.end());
  EXPECT_LT(errors[kMachines / 2], 8e-6);
}

TEST(Machines, AnUprightMagnetIsNotLost) {
  for (int k = 0; k < kMachines; ++k) {
    MachineSetting setting;
    setting.robot = "ndfeb_cylinder_1mm";
    setting.axis = {0, 0, 1};
    setting.seed = kFirst + static_cast<std::uint64_t>(k);
    EXPECT_FALSE(run_machine(setting, Law::now, square(), 8, 0).lost()) << setting.seed;
  }
}

// Coil 1 dead and known: 10 mT are too weak a moment for what seven coils can pull.
TEST(Machines, WithADeadCoilTheLoopRaisesTheFieldInPlaceOfLosingTheRobot) {
  int lost = 0;
  for (int k = 0; k < 3; ++k) {
    MachineSetting setting;
    setting.dead = {1};
    setting.seed = kFirst + static_cast<std::uint64_t>(k);
    EXPECT_FALSE(run_machine(setting, Law::now, square(), 8, 0).lost()) << setting.seed;
    setting.field_max = setting.field;
    lost += run_machine(setting, Law::now, square(), 8, 0).lost() ? 1 : 0;
  }
  EXPECT_GT(lost, 0) << "the field matters";
}

// Of the eight coils as many as a benchmark of 160 runs names in 95 %; of these six runs one may
// fail.
TEST(Machines, ACoilThatDiesIsNamedWithinFiveSecondsAndHealthyOnesAreNot) {
  int named = 0;
  for (const int coil : {2, 3, 4, 5, 7, 8}) {
    MachineSetting setting;
    setting.seed = kFirst + static_cast<std::uint64_t>(coil);
    const MachineResult healthy = run_machine(setting, Law::now, hold(), 8, 12);
    EXPECT_EQ(healthy.alarms, 0) << setting.seed;
    EXPECT_LT(healthy.rms, 4e-6) << "the tone that tells them does not shake the robot";
    setting.fault = {coil, 12, 0};
    const MachineResult found = run_machine(setting, Law::now, hold(), 8, 10);
    named += found.weak_coil == coil && found.weak - 12 < 5 ? 1 : 0;
  }
  EXPECT_GE(named, 5);
}

// Coils 4 and 6 are each other's like (2 and 8): which of them is weak is told only where the
// filter's own gain and delay, which a fault moves, and the field that a half of the current leaves
// are reckoned with. A benchmark of 400 runs names another coil first in 2 to 3 % (30 % before).
TEST(Machines, ACoilThatIsHalfAsStrongIsNamedAndNotItsLike) {
  int named = 0, others = 0;
  for (const int coil : {4, 6})
    for (std::uint64_t seed = 50001; seed <= 50004; ++seed) {
      MachineSetting setting;
      setting.seed = seed;
      setting.field_max = 20e-3;
      setting.fault = {coil, 15, 0.5};
      const MachineResult found = run_machine(setting, Law::now, hold(), 8, 17);
      named += found.weak_coil == coil && found.weak - 15 < 5 ? 1 : 0;
      others += found.weak_coil != coil && found.weak_coil != 0 ? 1 : 0;
    }
  EXPECT_GE(named, 7);
  EXPECT_LE(others, 1);
}

// Machines in each of which a healthy coil was named within 12 s of the first turns while of
// healthy coils the gains alone were taken to be off.
TEST(Machines, WhileTheAxisTurnsNoHealthyCoilIsNamedAndADeadOneIs) {
  int named = 0;
  for (const std::uint64_t seed : {1103, 1109, 1113}) {
    MachineSetting setting;
    setting.seed = seed;
    setting.field_max = 20e-3;
    setting.turning = 0.3;
    const MachineResult healthy = run_machine(setting, Law::now, hold(), 8, 25);
    EXPECT_EQ(healthy.weak_coil, 0) << "seed " << seed << " at " << healthy.weak;
    setting.fault = {3, 20, 0};
    const MachineResult dead = run_machine(setting, Law::now, hold(), 8, 25);
    named += dead.weak_coil == 3 && dead.weak - 20 < 5 ? 1 : 0;
  }
  // Not each one: the turns themselves hide one now and then.
  EXPECT_GE(named, 2);
}

// Of the thesis' PD, whose dead time of 0.17 s allows (pi / 2) / 0.17 s = 9 /s. What a limit cycle
// is the true place after half a minute decides: the way in rings at lower gains too, and dies.
TEST(Machines, ALimitCycleIsNamedWithinTenSeconds) {
  int cycling = 0;
  for (int k = 0; k < 4; ++k) {
    MachineSetting setting;
    setting.seed = kFirst + static_cast<std::uint64_t>(k);
    setting.proportional = 12;
    const MachineResult found = run_machine(setting, Law::pd, hold(), 8, 23);
    if (found.swings.back() < 60e-6) continue;
    ++cycling;
    EXPECT_GT(found.oscillation, 0) << setting.seed;
    EXPECT_LT(found.oscillation, 10) << setting.seed;
    EXPECT_GT(found.oscillating, 20) << setting.seed;
  }
  EXPECT_GE(cycling, 2);
}

// At its own gain, a sixth of that, the way in dies without a swing that could be named.
TEST(Machines, TheThesisLawAtItsOwnGainIsInNoLimitCycleAndNoneIsNamed) {
  for (int k = 0; k < 4; ++k) {
    MachineSetting setting;
    setting.seed = kFirst + static_cast<std::uint64_t>(k);
    const MachineResult found = run_machine(setting, Law::pd, hold(), 8, 23);
    EXPECT_LT(found.swings.back(), 5e-6) << setting.seed;
    EXPECT_LT(found.oscillation, 0) << setting.seed;
  }
}

// From 30 % wrong, in less than two minutes: the goals of the protocol calibrate_robot.
TEST(Machines, ARobotIsIdentifiedByItsOwnMotion) {
  for (const Mistake& mistake :
       {Mistake{"thin", -15e-3, 0.7, 1.3}, Mistake{"thick", 15e-3, 1.3, 0.7}})
    for (int k = 0; k < 2; ++k) {
      MachineSetting setting;
      setting.mistake = mistake;
      setting.seed = kFirst + static_cast<std::uint64_t>(k);
      const IdentifiedMachine found = identify_machine(setting);
      ASSERT_EQ(found.failure, "");
      EXPECT_LT(found.duration, 120);
      EXPECT_NEAR(found.x.delay.value, found.delay, 5e-3);
      EXPECT_NEAR(found.across.delay.value, found.delay, 5e-3);
      EXPECT_NEAR(found.sink_across.value / found.true_across, 1, 0.03);
      EXPECT_NEAR(found.sink_along.value / found.true_along, 1, 0.03);
      // To and fro, and falls, are on purpose.
      EXPECT_EQ(found.watched.alarms, 0) << mistake.name << " " << setting.seed;
    }
}

TEST(Machines, ASeedIsAMachine) {
  MachineSetting setting;
  setting.seed = kFirst;
  EXPECT_EQ(held(setting).rms, held(setting).rms);
  MachineSetting other = setting;
  other.seed = kFirst + 1;
  EXPECT_NE(held(setting).rms, held(other).rms);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::machines
