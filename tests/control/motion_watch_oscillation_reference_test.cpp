// MotionWatch's oscillations against its header's words: errors that are made of known parts.
// SPDX-License-Identifier: Apache-2.0
#include "control/motion_watch.h"
#include "tests/control/watched_motion.h"

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

using Eigen::Vector3d;
constexpr double kPi = 3.14159265358979323846;

double from_to(std::mt19937& random, double low, double high) {
  return low + (high - low) * (static_cast<double>(random()) / 4294967296.0);
}

double wave(double time, double period, double phase = 0.7) {
  return std::sin(2 * kPi * time / period + phase);
}

// Of the period one turn, as half of it is a whole number of turns, and a fiftieth, and of the
// amplitude a tenth: a window holds no whole number of periods, and the drift takes a part.
TEST(MotionWatch, ACycleOfAnyPeriodAndPhaseBesideADriftIsNamedWithItsAmplitude) {
  std::mt19937 random(3);
  for (int k = 0; k < 300; ++k) {
    const double period = std::exp(from_to(random, std::log(0.5), std::log(2.9)));
    const double amplitude = from_to(random, 30e-6, 3e-3), phase = from_to(random, 0, 2 * kPi);
    const Vector3d off = from_to(random, -2e-3, 2e-3) * Vector3d(1, -0.4, 0.7);
    const Vector3d drift = from_to(random, -0.2e-3, 0.2e-3) * Vector3d(0.3, 1, -0.8);
    const int axis = k % 3;
    const MotionWatch watch = watched(10, [&](WatchedMotion& now) {
      now.sigma = 1e-6;
      now.error = off + now.time * drift;
      now.error[axis] += amplitude * wave(now.time, period, phase);
    });
    ASSERT_TRUE(watch.oscillating()) << period << " s, " << amplitude << " m";
    EXPECT_NEAR(watch.period(), period, kTurn + 0.02 * period);
    EXPECT_NEAR(watch.amplitude(), amplitude, 0.1 * amplitude) << period;
  }
}

// A loop whose gain is too high for its frames cycles in a few of them. Of an odd number half is no
// whole number of frames, and one of five was never named. (Of 2.2 to 3.4 frames it returns in
// none.)
TEST(MotionWatch, ACycleOfAFewTurnsIsNamed) {
  for (const double turns : {2.0, 2.1, 3.6, 4.0, 4.5, 4.9, 5.0, 5.05, 5.5, 6.0, 7.0, 7.5}) {
    const MotionWatch watch = watched(10, [&](WatchedMotion& now) {
      now.sigma = 4e-6;
      now.error.x() = 200e-6 * wave(now.time, turns * kTurn);
    });
    ASSERT_TRUE(watch.oscillating()) << turns << " turns";
    EXPECT_NEAR(watch.period(), turns * kTurn, 0.55 * kTurn) << turns;
  }
}

// A frame that is looked at twice is one.
TEST(MotionWatch, ATimeThatComesTwiceIsOne) {
  MotionWatch once, twice;
  for (int k = 0; k < 200; ++k) {
    WatchedMotion now;
    now.time = k * kTurn;
    now.sigma = 4e-6;
    now.error.x() = 5e-3;
    once.add(now);
    twice.add(now);
    twice.add(now);
    ASSERT_EQ(once.off_target(), twice.off_target()) << k;
  }
  EXPECT_TRUE(twice.off_target());
}

TEST(MotionWatch, ADriftAndATurnAroundAndNothingAreNoCycle) {
  std::mt19937 random(5);
  for (int k = 0; k < 200; ++k) {
    const double turn = from_to(random, 2, 8), bend = from_to(random, -1e-3, 1e-3);
    EXPECT_FALSE(watched(10,
                         [&](WatchedMotion& now) {
                           now.error = Vector3d(bend, 2 * bend, -bend) * std::abs(now.time - turn);
                         })
                     .oscillating())
        << turn;
  }
  EXPECT_FALSE(watched(10, [](WatchedMotion& now) { now.error = {1e-3, 0, 0}; }).oscillating());
  EXPECT_FALSE(watched(10,
                       [](WatchedMotion& now) {
                         now.wanted = Vector3d(1, 1, 1) * wave(now.time, 0.75);
                         now.position = now.reference = now.wanted;
                       })
                   .oscillating())
      << "all but the error goes to and fro";
}

/// Whether a cycle of 0.75 s is named, of that rms, m, beside what `make` makes.
bool named(double rms, const MakeMotion& make, double until = 10) {
  return watched(until,
                 [&](WatchedMotion& now) {
                   now.error.y() = std::sqrt(2) * rms * wave(now.time, 0.75);
                   make(now);
                 })
      .oscillating();
}

// Docs: three standard deviations of the measurement, 0.1 s times the target's velocity about its
// mean (rms), 0.2 mm times the fastest rate of the axis, rms all of them. A tenth on either side
// is for windows that hold no whole number of periods.
TEST(MotionWatch, ACycleIsLargerThanNoiseAndThanWhatTargetAndAxisStir) {
  const auto limit = [](double rms, const MakeMotion& make) {
    return named(1.1 * rms, make) && !named(0.9 * rms, make);
  };
  EXPECT_TRUE(limit(60e-6, [](WatchedMotion& now) { now.sigma = 20e-6; }));
  const auto even = [](WatchedMotion& now) { return std::lround(now.time / kTurn) % 2 == 0; };
  EXPECT_TRUE(limit(60e-6, [&](WatchedMotion& now) { now.sigma = even(now) ? 5e-6 : 20e-6; }))
      << "the largest";
  EXPECT_TRUE(limit(100e-6, [&](WatchedMotion& now) {
    now.reference = Vector3d(3e-3, 0, -2e-3) + (even(now) ? 1 : -1) * Vector3d(0, 0.6e-3, 0.8e-3);
  })) << "what is constant of it stirs nothing";
  EXPECT_TRUE(named(1e-6, [](WatchedMotion& now) { now.reference = {1e-3, 2e-3, 3e-3}; }));
  EXPECT_TRUE(limit(100e-6, [](WatchedMotion& now) { now.turning = 0.48; }));
}

// Docs: the fastest rate, mean over a second, in the window or five seconds before it. The cycle
// is seen by its newest three seconds and more, so that eight seconds after a turn it is free.
TEST(MotionWatch, ATurnCountsBySecondsAndForEightOfThem) {
  const auto after = [](double rms, double length, double angle, double seconds) {
    return named(
        rms,
        [=](WatchedMotion& now) {
          const double since = now.time - (14 - seconds);
          now.turning = since > 0 && since <= length ? angle / length : 0;
        },
        14);
  };
  for (const double length : {kTurn, 0.5, 1.0}) {
    EXPECT_FALSE(after(85e-6, length, 0.5, 5)) << length << " s: of 0.1 mm";
    EXPECT_TRUE(after(115e-6, length, 0.5, 5)) << length;
  }
  EXPECT_TRUE(after(115e-6, 4, 2, 5)) << "half a radian per second for long";
  EXPECT_FALSE(after(85e-6, kTurn, 0.5, 8)) << "it began with the eight seconds";
  EXPECT_TRUE(after(85e-6, kTurn, 0.5, 8.6));
}

// Of a cycle of 1.25 s, of which one period, counted from the newest, is smaller.
TEST(MotionWatch, EachOfTheNewestThreePeriodsHasItsPart) {
  const auto cycles = [](int weak, double part) {
    return watched(10,
                   [=](WatchedMotion& now) {
                     const int back = static_cast<int>(std::floor((10 - now.time) / 1.25));
                     now.error.z() = (back == weak ? part : 1) * 0.1e-3 * wave(now.time, 1.25);
                   })
        .oscillating();
  };
  for (const int weak : {0, 1, 2}) {
    EXPECT_FALSE(cycles(weak, 0)) << weak;
    EXPECT_FALSE(cycles(weak, 0.3)) << weak;
    EXPECT_TRUE(cycles(weak, 0.75)) << weak;
  }
  EXPECT_TRUE(cycles(3, 0)) << "before them";
}

// An overtone of power b makes the autocorrelation (b - 1) / (b + 1) at half a period; two tones of
// equal power beat, and where one goes 1.6 times as fast it is 0.1 at a whole period.
TEST(MotionWatch, TheAutocorrelationIsDeepAtHalfAPeriodAndHighAtAWhole) {
  const auto tones = [](double power, double times) {
    return watched(10,
                   [=](WatchedMotion& now) {
                     now.error.x() = 0.1e-3 * (wave(now.time, 1.5) +
                                               std::sqrt(power) * wave(now.time, 1.5 / times, 0.2));
                   })
        .oscillating();
  };
  EXPECT_TRUE(tones(0.2, 2)) << "-0.67";
  EXPECT_FALSE(tones(0.6, 2)) << "-0.25";
  EXPECT_FALSE(tones(1, 1.6));
}

TEST(MotionWatch, AFastCycleIsNamedByThreeSecondsAndWhatWasBeforeAResetIsForgotten) {
  const MakeMotion fast = [](WatchedMotion& now) { now.error.x() = 1e-4 * wave(now.time, 0.5); };
  EXPECT_FALSE(watched(3 - kTurn, fast).oscillating());
  EXPECT_FALSE(watched(3 - kTurn, [&](WatchedMotion& now) {
                 fast(now);
                 now.time += 100;
               }).oscillating());
  MotionWatch watch = watched(3, fast);
  EXPECT_TRUE(watch.oscillating());
  WatchedMotion now;
  now.time = 3 - kTurn;
  watch.add(now);
  EXPECT_FALSE(watch.oscillating()) << "a time that runs backwards";
  watch = watched(3, fast);
  watch.reset();
  EXPECT_FALSE(watch.oscillating());
  EXPECT_EQ(watch.period(), 0);
  EXPECT_EQ(watch.amplitude(), 0);
}

TEST(MotionWatch, ACycleThatHasEndedIsNoMoreSaidAtTheNextLook) {
  const MakeMotion ends = [](WatchedMotion& now) {
    now.error.x() = now.time < 6 ? 1e-4 * wave(now.time, 0.5) : 0;
  };
  EXPECT_TRUE(watched(6, ends).oscillating());
  EXPECT_TRUE(watched(6.5 - kTurn, ends).oscillating()) << "looked at every half second";
  EXPECT_FALSE(watched(7, ends).oscillating());
}

TEST(MotionWatch, ADriftThatIsMuchLargerThanTheCycleTakesNoPartInItsAmplitude) {
  const MotionWatch watch = watched(3, [](WatchedMotion& now) {
    now.error = Vector3d(50e-3, 0, 0) * now.time;
    now.error.x() += 30e-6 * wave(now.time, 0.5);
  });
  EXPECT_TRUE(watch.oscillating());
  EXPECT_NEAR(watch.amplitude(), 30e-6, 3e-6);
  EXPECT_NEAR(watch.period(), 0.5, 1e-9);
}

/// Whether three periods of a cycle that just fill the last three seconds are named, where they
/// have so many turns. The watch looks every so many turns, the last time at the newest.
bool three_periods_named(int turns, int look) {
  MotionWatch watch;
  for (int k = (turns - 1) % look - look; k < turns; ++k) {
    WatchedMotion now;
    now.time = 3.0 * k / (turns - 1);
    now.error.z() = 1e-4 * std::sin(6 * kPi * k / turns + 0.7);
    watch.add(now);
  }
  return watch.oscillating();
}

TEST(MotionWatch, ThreePeriodsThatJustFillThreeSecondsAreEnough) {
  EXPECT_TRUE(three_periods_named(48, 8));
  EXPECT_TRUE(three_periods_named(12, 2)) << "four turns each";
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
