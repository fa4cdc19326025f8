// SPDX-License-Identifier: Apache-2.0
#include "vision/autofocus.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

const std::vector<AutofocusStrategy> kAll{
    AutofocusStrategy::sweep, AutofocusStrategy::coarse_to_fine, AutofocusStrategy::golden_section,
    AutofocusStrategy::fibonacci};

// A stage with play, and a focus curve as facts/vision.md measured it: a bell on a floor of noise.
struct Bench {
  double best = 3.217, width = 0.4, floor = 0.05, noise = 0.003, flash = 0, play = 0;
  std::mt19937_64 random{1};
  double lowest = 1e9, highest = -1e9, carriage = 0;
  int moves = 0;

  double measure(double commanded) {
    lowest = std::min(lowest, commanded), highest = std::max(highest, commanded);
    ++moves;
    // What the screw pulls upwards follows it; downwards it stays behind by the play.
    if (commanded > carriage) carriage = commanded;
    if (commanded < carriage - play) carriage = commanded + play;
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> unit(0, 1);
    const double x = (carriage - best) / width, lucky = unit(random),
                 error = noise * normal(random);
    return (1 / (1 + x * x) + floor) * (1 + error) * (lucky < flash ? 1.5 : 1);
  }
};

AutofocusSettings over(AutofocusStrategy strategy, double low = 0, double high = 10) {
  AutofocusSettings settings;
  settings.strategy = strategy;
  settings.low = low;
  settings.high = high;
  settings.step = 0.05;
  return settings;
}

AutofocusResult run(const AutofocusSettings& settings, Bench& bench) {
  Autofocus autofocus(settings);
  AutofocusStep step = autofocus.start();
  while (const double* position = std::get_if<double>(&step)) {
    if (bench.moves > 5000) throw std::runtime_error("does not end");
    step = autofocus.next(*position, bench.measure(*position));
  }
  EXPECT_THROW(autofocus.next(1, 1), std::logic_error);  // over is over
  return std::get<AutofocusResult>(step);
}

TEST(Autofocus, finds_the_peak_by_every_strategy_wherever_it_is) {
  for (const AutofocusStrategy strategy : kAll) {
    int moves = 0;
    for (int trial = 0; trial < 40; ++trial) {
      Bench bench;
      bench.best = 0.7 + 8.6 * trial / 39;
      bench.random.seed(static_cast<std::uint64_t>(trial));
      const AutofocusResult done = run(over(strategy), bench);
      ASSERT_TRUE(done.fit.peak) << name_of(strategy) << " at " << bench.best << ": "
                                 << name_of(done.fit.answer);
      EXPECT_NEAR(done.fit.peak->position, bench.best, 0.05)
          << name_of(strategy);  // the finest step
      EXPECT_NEAR(done.fit.peak->position, bench.best, 5 * done.fit.peak->sigma)
          << name_of(strategy);
      EXPECT_EQ(done.park.value(), done.fit.peak->position);
      EXPECT_EQ(done.readings, bench.moves);
      moves += bench.moves;
    }
    RecordProperty(std::string(name_of(strategy)), moves / 40);
    EXPECT_LT(moves / 40, strategy == AutofocusStrategy::sweep ? 202 : 60) << name_of(strategy);
  }
}

TEST(Autofocus, never_leaves_the_travel) {
  for (const AutofocusStrategy strategy : kAll) {
    for (const double best : {-2.0, 0.0, 0.02, 9.99, 10.0, 13.0}) {
      for (const double backlash : {0.0, 0.3}) {
        Bench bench;
        bench.best = best;
        AutofocusSettings settings = over(strategy);
        settings.backlash = backlash;
        const AutofocusResult done = run(settings, bench);
        EXPECT_GE(bench.lowest, 0) << name_of(strategy);
        EXPECT_LE(bench.highest, 10) << name_of(strategy);
        EXPECT_TRUE(done.park && *done.park >= 0 && *done.park <= 10);
      }
    }
  }
}

TEST(Autofocus, says_on_which_side_the_peak_lies_outside) {
  for (const AutofocusStrategy strategy : kAll) {
    Bench low, high;
    low.best = -0.5, high.best = 10.5;
    const AutofocusResult below = run(over(strategy), low), above = run(over(strategy), high);
    EXPECT_EQ(below.fit.answer, FocusAnswer::at_low_end) << name_of(strategy);
    EXPECT_EQ(above.fit.answer, FocusAnswer::at_high_end) << name_of(strategy);
    EXPECT_NEAR(below.park.value(), 0, 0.3)
        << name_of(strategy);  // the best it saw: the values there differ little
    EXPECT_NEAR(above.park.value(), 10, 0.3) << name_of(strategy);
  }
}

TEST(Autofocus, comes_at_every_position_from_below_when_the_stage_has_play) {
  for (const AutofocusStrategy strategy : kAll) {
    Bench bench;
    bench.play = 0.2;
    AutofocusSettings settings = over(strategy);
    settings.backlash = 0.3;
    const AutofocusResult done = run(settings, bench);
    ASSERT_TRUE(done.fit.peak) << name_of(strategy);
    EXPECT_NEAR(done.fit.peak->position, bench.best, 0.05)
        << name_of(strategy);  // not a play of 0.2 away
  }
}

TEST(Autofocus, takes_the_median_of_repeats_against_flashes) {
  for (const AutofocusStrategy strategy : kAll) {
    for (std::uint64_t seed = 0; seed < 10; ++seed) {
      Bench bench;
      bench.flash = 0.05;  // of the frames
      bench.random.seed(seed);
      AutofocusSettings settings = over(strategy);
      settings.repeats = 5;
      const AutofocusResult done = run(settings, bench);
      ASSERT_TRUE(done.fit.peak) << name_of(strategy) << " " << seed;
      EXPECT_NEAR(done.fit.peak->position, bench.best, 0.05) << name_of(strategy) << " " << seed;
    }
  }
}

TEST(Autofocus, looks_closer_for_a_peak_that_the_first_sweep_stepped_over) {
  for (const AutofocusStrategy strategy : kAll) {
    Bench bench;
    bench.best = 4.53, bench.width = 0.07, bench.floor = 1,
    bench.noise = 0.0005;  // the coarse spacing is 1
    const AutofocusResult done = run(over(strategy), bench);
    ASSERT_TRUE(done.fit.peak) << name_of(strategy);
    EXPECT_NEAR(done.fit.peak->position, bench.best, 0.05) << name_of(strategy);
  }
}

TEST(Autofocus, answers_that_there_is_no_peak_when_all_is_blank_or_alike) {
  for (const AutofocusStrategy strategy : kAll) {
    for (const double value : {0.0, 7.0}) {
      Autofocus autofocus(over(strategy));
      AutofocusStep step = autofocus.start();
      int count = 0;
      for (; std::holds_alternative<double>(step) && count < 5000; ++count)
        step = autofocus.next(std::get<double>(step), value);
      ASSERT_LT(count, 1000) << name_of(strategy);  // it ends: a full sweep and those before it
      const AutofocusResult& done = std::get<AutofocusResult>(step);
      EXPECT_EQ(done.fit.answer, FocusAnswer::no_peak);
      EXPECT_EQ(done.park.has_value(), value > 0);
    }
  }
}

TEST(Autofocus, ends_on_pure_noise_and_on_a_stuck_stage) {
  for (const AutofocusStrategy strategy : kAll) {
    for (std::uint64_t seed = 0; seed < 20; ++seed) {
      Bench noise;
      noise.width = 1e-9, noise.noise = 0.03, noise.random.seed(seed);
      EXPECT_FALSE(run(over(strategy), noise).fit.peak) << name_of(strategy) << " " << seed;
    }
    Autofocus stuck(over(strategy));
    AutofocusStep step = stuck.start();
    int count = 0;
    for (; std::holds_alternative<double>(step) && count < 5000; ++count)
      step = stuck.next(2.5, 1 + 0.1 * (count % 3));
    ASSERT_LT(count, 1000) << name_of(strategy);
    EXPECT_EQ(std::get<AutofocusResult>(step).fit.answer, FocusAnswer::no_peak);
  }
}

TEST(Autofocus, refuses_readings_and_settings_that_make_no_sense) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  Autofocus autofocus(over(AutofocusStrategy::sweep));
  EXPECT_THROW(autofocus.next(nan, 1), std::invalid_argument);
  EXPECT_THROW(autofocus.next(1, nan), std::invalid_argument);
  EXPECT_EQ(std::get<double>(autofocus.next(0, 1)), 0.05);  // and was not confused by them
  EXPECT_THROW(Autofocus(over(AutofocusStrategy::sweep, nan, 1)), std::invalid_argument);
  EXPECT_THROW(Autofocus(over(AutofocusStrategy::sweep, 1, 1)), std::invalid_argument);
  const auto refused = [](auto change) {
    AutofocusSettings settings;
    change(settings);
    EXPECT_THROW(settings.check(), std::invalid_argument);
  };
  refused([&](AutofocusSettings& s) { s.step = nan; });
  refused([](AutofocusSettings& s) { s.step = 1e-9; });
  refused([](AutofocusSettings& s) { s.coarse = 4; });
  refused([](AutofocusSettings& s) { s.repeats = 0; });
  refused([](AutofocusSettings& s) { s.backlash = 0.6; });
  refused([&](AutofocusSettings& s) { s.hysteresis = nan; });
  for (const AutofocusStrategy strategy : kAll)
    EXPECT_EQ(autofocus_strategy(name_of(strategy)), strategy);
  EXPECT_THROW(autofocus_strategy("luck"), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
