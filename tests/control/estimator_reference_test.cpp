// PositionEstimator against a dense Kalman filter of eight states, over irregular steps.
// SPDX-License-Identifier: Apache-2.0
#include "tests/control/estimator_reference.h"

namespace vitreo::control {
namespace VITREO_TEST_FILE {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using reference::Pair;
using reference::settings;

TEST(PositionEstimatorReference, predicts_and_updates_as_the_equations_say) {
  Pair pair(settings());
  pair.before({1.3e-4, 0.6e-4, -2.1e-4});
  pair.begin();
  for (int k = 0; k < 40; ++k) pair.step(pair.next());
  // so that the run is one in which gain and delay are found
  EXPECT_NEAR(pair.filter.x(6), pair.gain, 0.1);
  EXPECT_NEAR(pair.filter.x(7), pair.delay, 0.005);
}

TEST(PositionEstimatorReference, leaves_out_what_is_known) {
  for (const auto& [gain_sigma, delay_sigma] :
       {std::pair{0.0, 0.0}, std::pair{0.25, 0.0}, std::pair{0.0, 0.03}}) {
    EstimatorSettings s = settings();
    s.gain_sigma = gain_sigma;
    s.delay_sigma = delay_sigma;
    Pair pair(s, 17);
    pair.begin();
    for (int k = 0; k < 12; ++k) pair.step(pair.next());
    const auto e = pair.estimator.at(pair.time + 0.1);
    EXPECT_EQ(e->gain_sigma == 0 && e->gain == 0, gain_sigma == 0);
    EXPECT_EQ(e->delay_sigma == 0 && e->delay == 0, delay_sigma == 0);
  }
}

TEST(PositionEstimatorReference, acts_on_what_was_commanded_before_the_first_measurement) {
  // One command, half a lag before the start and behind a delay: it has only begun to act. Nothing
  // more is commanded, so an estimator that dropped it would not move.
  Pair pair(settings());
  pair.before({-0.9e-4, 2.2e-4, 0.3e-4});
  pair.command(pair.time - 0.043 - 0.0085, {3e-4, -5e-4, 7e-4});
  pair.commanded_until = 1e9;
  pair.begin();
  EXPECT_GT(pair.estimator.at(pair.time)->commanded.z(), 2e-4);
  for (int k = 0; k < 10; ++k) pair.step(pair.next());
}

TEST(PositionEstimatorReference, takes_the_same_time_twice_and_a_command_anew) {
  Pair pair(settings());
  pair.begin();
  for (int k = 0; k < 5; ++k) pair.step(pair.next());
  pair.step(pair.next(0));
  const double last = pair.filter.steps.list.back().first;
  pair.filter.steps.list.pop_back();  // one at the same time replaces the last
  pair.truth.list.pop_back();
  pair.command(last, {9e-4, -8e-4, 7e-4});
  for (int k = 0; k < 5; ++k) pair.step(pair.next());
}

TEST(PositionEstimatorReference, walks_as_fast_as_it_was_last_told) {
  Pair pair(settings());
  pair.begin();
  for (const double walk : {250e-6, 9e-6, 1e-3}) {
    pair.estimator.set_disturbance_walk(walk);
    pair.filter.s.disturbance_walk = walk;
    pair.compare_at(pair.time + 0.2);
    for (int k = 0; k < 5; ++k) pair.step(pair.next());
  }
}

TEST(PositionEstimatorReference, holds_gain_and_delay_within_their_bounds) {
  struct Case {
    double gain, delay, gain_sigma, delay_sigma, interval;
    int at, side;  // the state that meets its bound, and which
  };
  for (const Case& c :
       {Case{-1.5, 0, 0.5, 0, 0.02, 6, -1}, Case{4.5, 0, 1, 0, 0.02, 6, 1},
        Case{0, -0.09, 0, 0.05, 0.02, 7, -1}, Case{0, 0.4, 0, 0.1, 0.5, 7, 1},
        Case{-1.5, -0.09, 0.5, 0.05, 0.02, 6, -1}, Case{-0.2, -0.1, 0.2, 0.06, 0.1, 7, -1},
        Case{6, 0.35, 1, 0.1, 0.3, 6, 1}}) {
    EstimatorSettings s = settings();
    s.gain_sigma = c.gain_sigma;
    s.gain_walk = 7e-2;
    s.delay_sigma = c.delay_sigma;
    s.delay_walk = 9e-3;
    s.max_disturbance = 1;
    Pair pair(s, 8);
    pair.gain = c.gain;
    pair.delay = c.delay;
    pair.command_interval = c.interval;
    pair.commanded_until = pair.time - 1.5;
    pair.tolerance = 1e-7;  // what the bound takes away is carried on by the step
    pair.begin();
    const double bound = c.at == 6 ? (c.side < 0 ? -0.85 : 3) : (c.side < 0 ? -0.043 : 0.25);
    int met = 0, left = 0;
    for (int k = 0; k < 40; ++k) {
      pair.step(pair.next());
      const bool here = pair.filter.at_bound && pair.filter.x(c.at) == bound;
      if (here) ++met;
      if (!here && met > 0) ++left;
      if (here) {
        const auto e = pair.estimator.at(pair.time);
        EXPECT_EQ(c.at == 6 ? e->gain : e->delay, bound);
      }
    }
    EXPECT_GT(met, 0) << c.gain << " " << c.delay;
    EXPECT_GT(left, 0) << c.gain << " " << c.delay;
  }
}

TEST(PositionEstimatorReference, is_never_less_certain_than_at_the_start) {
  EstimatorSettings s = settings();
  s.gain_sigma = 0.2;
  s.gain_walk = 0.3;
  s.delay_sigma = 0.01;
  s.delay_walk = 0.02;
  Pair pair(s);
  pair.command_sigma = 2e-5;  // little motion, little said of gain and delay
  pair.begin();
  int capped = 0;
  for (int k = 0; k < 20; ++k) {
    pair.step(pair.next(0.15));
    const auto e = pair.estimator.at(pair.time);
    EXPECT_LE(e->gain_sigma, 0.2 * (1 + 1e-14));
    EXPECT_LE(e->delay_sigma, 0.01 * (1 + 1e-14));
    if (e->gain_sigma > 0.2 * (1 - 1e-14) && e->delay_sigma > 0.01 * (1 - 1e-14)) ++capped;
  }
  EXPECT_GT(capped, 3);
}

TEST(PositionEstimatorReference, holds_the_disturbance_below_its_limit_in_length) {
  EstimatorSettings s = settings();
  s.max_disturbance = 3.3e-4;
  s.gain_walk = 7e-2;
  Pair pair(s);
  pair.disturbance = {3e-4, -1.2e-4, -2e-4};
  pair.gain = -1.6;  // and beyond a bound, which gives to the disturbance what it takes
  pair.begin();
  int held = 0, both = 0;
  for (int k = 0; k < 30; ++k) {
    pair.step(pair.next());
    const double length = pair.estimator.at(pair.time)->disturbance.norm();
    EXPECT_LE(length, s.max_disturbance * (1 + 1e-14));
    const bool here = length > s.max_disturbance * (1 - 1e-12);
    held += here ? 1 : 0;
    both += here && pair.filter.at_bound ? 1 : 0;
  }
  EXPECT_GT(held, 5);
  EXPECT_LT(held, 30);
  EXPECT_GT(both, 0);
}

TEST(PositionEstimatorReference, goes_on_over_outliers_and_starts_anew_at_the_third_in_a_row) {
  EstimatorSettings s = settings();
  s.gate = 6;
  s.gate_error = 15e-6;
  Pair pair(s);
  pair.begin();
  for (int k = 0; k < 6; ++k) pair.step(pair.next());
  const auto outlier = [&](const Vector3d& away) {
    PositionMeasurement m = pair.next();
    m.position += away;
    EXPECT_GT(pair.filter.gated(m), s.gate);
    return m;
  };
  const auto reject = [&](const Vector3d& away) {
    const PositionMeasurement m = outlier(away);
    EXPECT_FALSE(pair.estimator.measure(m));
    pair.filter.advance(m.time);  // a prediction only
    pair.compare_at(m.time);
    pair.compare_at(m.time + 0.12);
  };
  // One and two are rejected, and a good one in between ends the row.
  for (int round = 0; round < 2; ++round) {
    reject({2e-3, 1e-3, -3e-3});
    reject({-2e-3, 1e-3, 4e-3});
    pair.step(pair.next());
  }
  reject({1e-3, 0, 0});
  pair.step(pair.next());
  for (int round = 0; round < 2; ++round) {
    const Matrix3d gain = pair.estimator.position_gain(), rate = pair.estimator.velocity_gain();
    const Vector3d away = Vector3d(2e-3, -5e-3, 3e-3) * (1 - 3 * round);
    reject(away);
    reject(away);
    const PositionMeasurement third = outlier(away);
    EXPECT_TRUE(pair.estimator.measure(third));
    pair.filter.advance(third.time);
    // Its value is kept, its covariance the start's added to what it was by then.
    const Matrix3d disturbance = pair.filter.P.block(3, 3, 3, 3) + pair.filter.initial();
    pair.filter.start(third, disturbance);
    pair.position += away;
    EXPECT_FALSE(pair.estimator.innovation());
    EXPECT_EQ(pair.estimator.position_gain(), gain);  // of the last update
    EXPECT_EQ(pair.estimator.velocity_gain(), rate);
    pair.compare_at(pair.time);
    pair.compare_at(pair.time + 0.2);
    for (int k = 0; k < 4; ++k) pair.step(pair.next());
  }
}

TEST(PositionEstimatorReference, starts_anew_after_max_age) {
  EstimatorSettings s = settings();
  s.max_age = 0.4;
  Pair pair(s);
  pair.begin();
  for (int k = 0; k < 8; ++k) pair.step(pair.next());
  pair.step(pair.next(0.39));  // not yet
  const PositionMeasurement m = pair.next(0.41);
  EXPECT_TRUE(pair.estimator.measure(m));
  EXPECT_FALSE(pair.estimator.innovation());
  // The disturbance is kept as it was, walked; gain and delay keep their values.
  pair.filter.advance(m.time);
  pair.filter.start(m, pair.filter.P.block(3, 3, 3, 3));
  pair.compare_at(pair.time);
  pair.compare_at(pair.time + 0.3);
  for (int k = 0; k < 8; ++k) pair.step(pair.next());
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
