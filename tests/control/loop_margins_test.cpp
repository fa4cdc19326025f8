// Margins against closed forms, against an independent computation (facts/control_limits 3), and
// against the loop itself.
// SPDX-License-Identifier: Apache-2.0
#include "control/loop_margins.h"

#include "control/estimator.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <stdexcept>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

double db(double factor) { return 20 * std::log10(factor); }

// The stationary observer of natural frequency wo, at 15 measurements a second.
SampledLoop with_observer(double proportional, double wo) {
  constexpr double kNoise = 4.3e-6, kPeriod = 1.0 / 15;
  EstimatorSettings settings;
  settings.gate = 0;
  settings.position_walk = 0.1 * kNoise / std::sqrt(0.174);
  settings.disturbance_walk = wo * wo * kNoise * std::sqrt(kPeriod);
  PositionEstimator filter(settings);
  for (int k = 0; k < 2000; ++k)
    filter.measure({k * kPeriod, {0, 0, 0}, kNoise * kNoise * Eigen::Matrix3d::Identity()});
  SampledLoop loop;
  loop.proportional = proportional;
  loop.position_gain = filter.position_gain()(0, 0);
  loop.velocity_gain = filter.velocity_gain()(0, 0);
  return loop;
}

// Without an observer's memory (p^ as measured, no disturbance) and without delays the loop is
// e' = (1 - Kp g Ts) e: unstable from Kp g Ts = 2 on.
TEST(LoopMargins, OfASampledIntegratorAreTwoOverGainTimesPeriod) {
  SampledLoop loop;
  loop.latency = loop.command_delay = loop.command_lag = loop.horizon = 0;
  loop.position_gain = 1;
  loop.velocity_gain = 1e-4;  // next to none: its eigenvalue is just inside the circle
  loop.proportional = 3;
  const LoopMargins margins = loop_margins(loop);
  EXPECT_TRUE(margins.stable);
  EXPECT_NEAR(margins.gain_up, 2 / (3 * loop.period), 0.02 * margins.gain_up);
  EXPECT_EQ(margins.gain_down, 0);
}

TEST(LoopMargins, AgreeWithTheStudyOfTheFrequencyResponse) {
  struct Row {
    double proportional, wo, gain_db, delay_ms;
  };
  // facts/control_limits 3, computed by other means; rounded there.
  for (const Row& row : {Row{2.88, 4.5, 7.5, 182}, Row{2, 2, 11.8, 378}, Row{1.26, 0.86, 17.5, 900},
                         Row{2.47, 3.3, 9.0, 240}, Row{2.87, 1.34, 13.8, 508}}) {
    const LoopMargins margins = loop_margins(with_observer(row.proportional, row.wo));
    EXPECT_NEAR(db(margins.gain_up), row.gain_db, 0.15);
    EXPECT_NEAR(margins.delay_more * 1e3, row.delay_ms, 0.01 * row.delay_ms);
    EXPECT_NEAR(margins.delay_less, 0.13, 1e-6) << "stable down to no delay";
  }
}

TEST(LoopMargins, AreWhereTheEigenvaluesLeaveTheCircle) {
  const SampledLoop loop = with_observer(2.87, 5.7);
  const LoopMargins margins = loop_margins(loop);
  EXPECT_LT(spectral_radius(loop, 0.98 * margins.gain_up, 0), 1);
  EXPECT_GT(spectral_radius(loop, 1.02 * margins.gain_up, 0), 1);
  EXPECT_LT(spectral_radius(loop, 1, 0.98 * margins.delay_more), 1);
  EXPECT_GT(spectral_radius(loop, 1, 1.02 * margins.delay_more), 1);
}

TEST(LoopMargins, ALoopThatOscillatesHasNone) {
  SampledLoop loop = with_observer(2.87, 5.7);
  loop.proportional = 30;
  const LoopMargins margins = loop_margins(loop);
  EXPECT_FALSE(margins.stable);
  EXPECT_EQ(margins.gain_up, 1);
  EXPECT_EQ(margins.delay_more, 0);
}

TEST(LoopMargins, NamesWhatIsWrong) {
  SampledLoop loop;
  loop.period = 0;
  EXPECT_THROW(loop_margins(loop), std::invalid_argument);
  EXPECT_THROW(spectral_radius({}, 1, -1), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
