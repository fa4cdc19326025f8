// The estimator against its closed forms and statistics, and on bad days.
// SPDX-License-Identifier: Apache-2.0
#include "control/estimator.h"

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

const double kNan = std::numeric_limits<double>::quiet_NaN();

std::string complaint(const std::function<void()>& call) {
  try {
    call();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

PositionMeasurement at(double time, const Eigen::Vector3d& position, double sigma = 1e-6) {
  return {time, position, sigma * sigma * Eigen::Matrix3d::Identity()};
}

TEST(CommandHistory, moves_as_delay_and_lag_say) {
  CommandHistory history(0.05, 0.02);
  history.add(1.0, {1, 0, 0});
  history.add(1.2, {0, 2, 0});
  const auto motion = history.advance({0, 0, 0}, 0.9, 1.45);
  // By hand: x acts from 1.05 to 1.25, y from there; each through exp(-t/0.02). Rounding only.
  const double e1 = std::exp(-0.2 / 0.02), x = 1 - e1;
  EXPECT_NEAR(motion.moved.x(), 0.2 - 0.02 * (1 - e1) + x * 0.02 * (1 - e1), 1e-15);
  EXPECT_NEAR(motion.moved.y(), 2 * (0.2 - 0.02 * (1 - e1)), 1e-15);
  EXPECT_NEAR(motion.velocity.x(), x * e1, 1e-15);
  // In two steps the same as in one.
  const auto half = history.advance({0, 0, 0}, 0.9, 1.1);
  const auto rest = history.advance(half.velocity, 1.1, 1.45);
  EXPECT_LT((half.moved + rest.moved - motion.moved).norm(), 1e-15);
  EXPECT_LT((history.velocity_at(1.45) - motion.velocity).norm(), 1e-8);
  history.forget_before(1.3);
  EXPECT_LT((history.advance(half.velocity, 1.3, 1.4).moved.x()), 1e-1);
}

TEST(CommandHistory, falls_until_the_first_command_acts) {
  CommandHistory history(0.05, 0.02);
  history.set_before({0, 0, -1.5});
  history.add(1.0, {0, 0, 0});
  EXPECT_NEAR(history.velocity_at(1.04).z(), -1.5, 1e-8);
  EXPECT_NEAR(history.advance({0, 0, -1.5}, 0, 1.05).moved.z(), -1.5 * 1.05, 1e-12);
  EXPECT_NEAR(history.velocity_at(1.05 + 0.02).z(), -1.5 / std::exp(1), 1e-8);
}

TEST(CommandHistory, keeps_the_newest_when_it_is_full) {
  CommandHistory history(0, 0);
  for (int k = 0; k < 5000; ++k) history.add(1e-3 * k, {1e-3 * k, 0, 0});
  // The last half second: the sum of 4.5 to 5 times a millisecond each.
  EXPECT_NEAR(history.advance({0, 0, 0}, 4.5, 5.0).moved.x(), 0.5 * (4.5 + 4.999) / 2, 1e-9);
}

TEST(PositionEstimator, knows_nothing_before_the_first_measurement_and_too_long_after_the_last) {
  PositionEstimator estimator({});
  EXPECT_FALSE(estimator.at(5));
  estimator.measure(at(5, {1e-3, 0, 0}));
  ASSERT_TRUE(estimator.at(5));
  EXPECT_EQ(estimator.at(5)->position, Eigen::Vector3d(1e-3, 0, 0));
  EXPECT_TRUE(estimator.at(5.9));
  EXPECT_NEAR(estimator.at(5.9)->age, 0.9, 1e-12);
  EXPECT_FALSE(estimator.at(6.1));  // max_age is 1 s
}

TEST(PositionEstimator, finds_the_disturbance_and_predicts_over_the_latency) {
  EstimatorSettings settings;
  settings.command_delay = 0.05;
  settings.command_lag = 0.01;
  PositionEstimator estimator(settings);
  const Eigen::Vector3d push(100e-6, -50e-6, 20e-6);
  CommandHistory truth(0.05, 0.01);
  Eigen::Vector3d lagged(0, 0, 0), place(0, 0, 0);
  for (int k = 0; k < 100; ++k) {
    const double t = k / 15.0;
    const Eigen::Vector3d u(300e-6 * std::sin(t), 300e-6 * std::cos(2 * t), 0);
    // The measurement that comes at t was taken 130 ms before.
    const auto then = truth.advance({0, 0, 0}, -1, t - 0.13);
    estimator.measure(at(t - 0.13, then.moved + push * (t - 0.13 + 1)));
    estimator.command(t, u);
    truth.add(t, u);
  }
  const double now = 99 / 15.0 + 0.05;
  place = truth.advance(lagged, -1, now).moved + push * (now + 1);
  const auto estimate = estimator.at(now);
  ASSERT_TRUE(estimate);
  // Exact measurements of an exact model: what is left of the first guess, with time constants
  // below half a second.
  EXPECT_LT((estimate->disturbance - push).norm(), 1e-9);
  EXPECT_LT((estimate->position - place).norm(), 1e-9);
}

TEST(PositionEstimator, is_as_sure_as_it_is_right_with_irregular_and_missing_measurements) {
  EstimatorSettings settings;
  settings.disturbance_walk = 50e-6;
  settings.position_walk = 2e-6;
  settings.gate = 0;
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(0.02, 0.12);
  const auto draw = [&](double size) {
    const double x = normal(random), y = normal(random), z = normal(random);
    return Eigen::Vector3d(size * Eigen::Vector3d(x, y, z));
  };
  double sum = 0;
  int count = 0;
  for (int run = 0; run < 100; ++run) {
    PositionEstimator estimator(settings);
    Eigen::Matrix3d r;
    r << 9, 3, 0, 3, 16, 2, 0, 2, 100;  // um^2: a depth that is known worse, and correlations
    r *= 1e-12;
    const Eigen::Matrix3d root = r.llt().matrixL();
    Eigen::Vector3d p(0, 0, 0), d = draw(settings.initial_disturbance);
    double t = 0;
    for (int k = 0; k < 40; ++k) {
      if (run % 2 == 0 || k % 3 != 0) estimator.measure({t, p + root * draw(1), r});
      double next = t + uniform(random);
      const double step = (next - t) / 50;
      for (int i = 0; i < 50; ++i) {
        d += draw(settings.disturbance_walk * std::sqrt(step));
        p += step * d + draw(settings.position_walk * std::sqrt(step));
      }
      t = next;
    }
    const auto estimate = estimator.at(t);
    ASSERT_TRUE(estimate);
    Eigen::Matrix<double, 6, 1> error;
    error << estimate->position - p, estimate->disturbance - d;
    sum += error.dot(estimate->covariance.llt().solve(error));
    ++count;
  }
  // Chi-squared of 6 degrees, mean of 100: 6 +- 0.35; here four of them.
  EXPECT_NEAR(sum / count, 6, 1.4);
}

TEST(PositionEstimator, passes_over_an_outlier_and_believes_the_third) {
  EstimatorSettings settings;
  settings.gate = 6;
  PositionEstimator estimator(settings);
  for (int k = 0; k < 20; ++k) EXPECT_TRUE(estimator.measure(at(0.1 * k, {0, 0, 0})));
  EXPECT_FALSE(estimator.measure(at(2.0, {5e-3, 0, 0})));
  EXPECT_LT(estimator.at(2.0)->position.norm(), 1e-5);
  EXPECT_FALSE(estimator.measure(at(2.1, {5e-3, 0, 0})));
  EXPECT_TRUE(estimator.measure(at(2.2, {5e-3, 0, 0})));
  EXPECT_EQ(estimator.at(2.2)->position.x(), 5e-3);
}

TEST(PositionEstimator, winds_nothing_up_while_the_robot_is_held_fast) {
  EstimatorSettings settings;
  settings.max_disturbance = 1e-3;
  PositionEstimator estimator(settings);
  for (int k = 0; k < 200; ++k) {
    estimator.command(0.1 * k, {5e-3, 0, 0});  // pushed hard, and stuck
    estimator.measure(at(0.1 * k, {0, 0, 0}));
  }
  EXPECT_LE(estimator.at(20)->disturbance.norm(), 1e-3 * (1 + 1e-12));
}

/// 30 s of a robot whose response is `gain` times the believed and comes `late` s later, under
/// commands that change at each frame; measured with 4 um.
PositionEstimate identified(double gain, double late, std::uint64_t seed,
                            PositionEstimator& filter) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  CommandHistory truth(0.05 + late, 0.0106);
  const Eigen::Vector3d push(200e-6, -100e-6, 50e-6);
  for (int k = 0; k < 450; ++k) {
    const double t = k / 15.0;
    Eigen::Vector3d place = gain * truth.advance({0, 0, 0}, -1, t - 0.08).moved + push * (t + 1);
    for (double& coordinate : place) coordinate += 4e-6 * normal(random);
    filter.measure(at(t - 0.08, place, 4e-6));
    const Eigen::Vector3d u(600e-6 * std::sin(2.1 * t), 600e-6 * std::cos(1.3 * t), 200e-6);
    filter.command(t, u);
    truth.add(t, u);
  }
  return *filter.at(449 / 15.0);
}

TEST(PositionEstimator, finds_the_gain_and_the_delay_of_the_loop_and_knows_how_well) {
  EstimatorSettings settings;
  settings.disturbance_walk = 2e-6;
  settings.initial_disturbance = 1e-3;
  settings.gain_sigma = 0.35;
  settings.delay_sigma = 30e-3;
  double gains = 0, delays = 0;
  int count = 0;
  for (const double gain : {0.5, 1.0, 1.6})
    for (const double late : {-40e-3, 0.0, 50e-3})
      for (std::uint64_t seed = 1; seed <= 4; ++seed) {
        PositionEstimator filter(settings);
        const PositionEstimate found = identified(gain, late, seed, filter);
        EXPECT_NEAR(1 + found.gain, gain, 0.03) << late;
        EXPECT_NEAR(found.delay, late, 6e-3) << gain;
        gains += std::pow((1 + found.gain - gain) / found.gain_sigma, 2);
        delays += std::pow((found.delay - late) / found.delay_sigma, 2);
        ++count;
      }
  // Chi-squared of one degree, 36 of them: 1 +- 0.24 where the filter's noise is the plant's, and
  // less here, where nothing walks.
  EXPECT_LT(gains / count, 1.75);
  EXPECT_LT(delays / count, 1.75);
}

TEST(PositionEstimator, a_robot_that_does_not_answer_meets_a_bound_and_it_says_so) {
  EstimatorSettings settings;
  settings.gain_sigma = 0.35;
  settings.delay_sigma = 30e-3;
  PositionEstimator filter(settings);
  bool told = false;
  for (int k = 0; k < 300; ++k) {
    filter.measure(at(k / 15.0, {0, 0, 0}));
    told = told || filter.at_bound();
    filter.command(k / 15.0, {1e-3 * std::sin(0.9 * k), 1e-3 * std::cos(0.5 * k), 0});
  }
  EXPECT_TRUE(told);
  const auto estimate = filter.at(20);
  EXPECT_GE(estimate->gain, -0.85 - 1e-12);
  EXPECT_TRUE(estimate->position.allFinite());
  EXPECT_LT(estimate->position.norm(), 30e-6);
}

Eigen::Matrix<double, 8, 1> state_of(const PositionEstimator& filter, double time) {
  const PositionEstimate now = *filter.at(time);
  Eigen::Matrix<double, 8, 1> state;
  state << now.position, now.disturbance, now.gain, now.delay;
  return state;
}

// Two filters that were told a little differently once, and then the same: their difference goes on
// as last_update() says.
TEST(PositionEstimator, says_how_an_error_of_its_state_goes_on) {
  EstimatorSettings settings;
  settings.gain_sigma = 0.35;
  settings.delay_sigma = 30e-3;
  PositionEstimator one(settings), other(settings);
  double compared = 0;
  for (int k = 0; k < 60; ++k) {
    const double time = k / 15.0;
    // It goes as it is told, but for a little.
    const Eigen::Vector3d off(1e-6 * std::sin(0.7 * k), 1e-6 * std::cos(0.4 * k), 1e-6);
    const Eigen::Vector3d seen = (k > 0 ? one.at(time)->position : Eigen::Vector3d(0, 0, 0)) + off;
    const Eigen::Vector3d lie =
        k == 25 ? Eigen::Vector3d(2e-6, -1e-6, 1e-6) : Eigen::Vector3d(0, 0, 0);
    const bool known = k > 25;
    Eigen::Matrix<double, 8, 1> error;
    if (known) error = state_of(other, (k - 1) / 15.0) - state_of(one, (k - 1) / 15.0);
    one.measure(at(time, seen));
    other.measure(at(time, seen + lie));
    if (known) {
      const EstimatorUpdate& update = one.last_update();
      ASSERT_EQ(update.bounded.norm(), 0) << k;
      Eigen::Matrix<double, 8, 1> went = error;
      went.head<3>() +=
          error.segment<3>(3) / 15 + update.by_gain * error[6] + update.by_delay * error[7];
      went -= update.gain * went.head<3>();
      const Eigen::Matrix<double, 8, 1> found = state_of(other, time) - state_of(one, time);
      const Eigen::Matrix<double, 8, 1> unit =
          (Eigen::Matrix<double, 8, 1>() << 1e-6, 1e-6, 1e-6, 1e-5, 1e-5, 1e-5, 1e-2, 1e-3)
              .finished();
      EXPECT_LT((found - went).cwiseQuotient(unit).norm(), 0.02) << k;
      compared += error.cwiseQuotient(unit).norm();
      EXPECT_GT(std::abs(update.by_gain.norm()), 0) << k;
    }
    one.command(time, {1e-3 * std::sin(0.9 * k), 1e-3 * std::cos(0.5 * k), 0});
    other.command(time, {1e-3 * std::sin(0.9 * k), 1e-3 * std::cos(0.5 * k), 0});
  }
  EXPECT_GT(compared, 5) << "they differ";
}

TEST(PositionEstimator, says_what_its_bounds_added) {
  EstimatorSettings settings;
  settings.gain_sigma = 0.35;
  settings.delay_sigma = 30e-3;
  PositionEstimator filter(settings);
  int bounded = 0;
  for (int k = 0; k < 300; ++k) {
    const Eigen::Vector3d seen(0, 0, 0);
    if (filter.measure(at(k / 15.0, seen)) && filter.innovation()) {
      const EstimatorUpdate& update = filter.last_update();
      const Eigen::Vector3d value = filter.innovation()->value;
      const Eigen::Vector3d unbounded = seen - value + update.gain.topRows<3>() * value;
      const Eigen::Vector3d added = filter.at(k / 15.0)->position - unbounded;
      EXPECT_LT((added - update.bounded.head<3>()).norm(), 1e-15) << k;
      bounded += update.bounded.head<3>().norm() > 1e-9 ? 1 : 0;
    }
    filter.command(k / 15.0, {1e-3 * std::sin(0.9 * k), 1e-3 * std::cos(0.5 * k), 0});
  }
  EXPECT_GT(bounded, 3);
}

TEST(PositionEstimator, takes_up_again_after_a_long_silence) {
  PositionEstimator estimator({});
  for (int k = 0; k < 20; ++k) estimator.measure(at(0.1 * k, {10e-6 * k, 0, 0}));
  EXPECT_TRUE(estimator.measure(at(30, {2e-3, 0, 0})));
  EXPECT_EQ(estimator.at(30)->position.x(), 2e-3);
  EXPECT_NEAR(estimator.at(30)->disturbance.x(), 100e-6,
              30e-6);  // what it was: 10 um in 0.1 s, with its sigma
}

TEST(PositionEstimator, names_what_is_wrong) {
  PositionEstimator estimator({});
  EXPECT_EQ(complaint([&] {
              estimator.measure(at(kNan, {0, 0, 0}));
            }),
            "measurement time: not finite");
  EXPECT_EQ(complaint([&] {
              estimator.measure(at(0, {0, kNan, 0}));
            }),
            "measured position: not finite");
  EXPECT_EQ(complaint([&] {
              estimator.measure({0, {0, 0, 0}, Eigen::Matrix3d::Zero()});
            }),
            "measurement covariance: not positive definite");
  Eigen::Matrix3d skew = 1e-12 * Eigen::Matrix3d::Identity();
  skew(0, 1) = 1e-13;
  EXPECT_EQ(complaint([&] {
              estimator.measure({0, {0, 0, 0}, skew});
            }),
            "measurement covariance: not symmetric");
  EXPECT_FALSE(estimator.at(0));  // none of these left a trace
  estimator.measure(at(1, {0, 0, 0}));
  EXPECT_EQ(complaint([&] {
              estimator.measure(at(0.9, {0, 0, 0}));
            }),
            "measurement time: runs backwards");
  EXPECT_EQ(complaint([&] { estimator.at(0.9); }), "time: before the last measurement");
  EXPECT_EQ(complaint([&] {
              estimator.command(0, {0, kNan, 0});
            }),
            "commanded velocity: not finite");
  estimator.command(1, {0, 0, 0});
  EXPECT_EQ(complaint([&] { estimator.command(0.9, {0, 0, 0}); }), "command time: runs backwards");
  EstimatorSettings bad;
  bad.command_delay = -1;
  EXPECT_EQ(complaint([&] { PositionEstimator x(bad); }), "command_delay: must be at least 0 s");
  bad = {};
  bad.disturbance_walk = 0;
  EXPECT_EQ(complaint([&] { PositionEstimator x(bad); }),
            "disturbance_walk: must be above 0 m/s per sqrt(s)");
}

TEST(PositionEstimator, recovers_from_a_leap_of_what_pushes_however_sharp_it_thought_itself) {
  EstimatorSettings settings;
  settings.disturbance_walk = 1e-5;  // hardly any
  PositionEstimator estimator(settings);
  const Eigen::Matrix3d sharp = 1e-14 * Eigen::Matrix3d::Identity();  // 0.1 um
  double place = 0, passed = 0;
  for (int n = 0; n < 150; ++n) {
    estimator.measure({n / 15.0, {place, 0, 0}, sharp});
    place += (n < 75 ? 0 : 1e-3) / 15.0;  // then 1 mm/s that was not commanded
  }
  for (int n = 150; n < 180; ++n) {
    passed += estimator.measure({n / 15.0, {place, 0, 0}, sharp}) ? 0 : 1;
    place += 1e-3 / 15.0;
  }
  EXPECT_EQ(passed, 0);
  EXPECT_NEAR(estimator.at(179 / 15.0)->disturbance.x(), 1e-3, 1e-6);
}

TEST(PositionEstimator, an_uneven_covariance_of_a_measurement_does_not_grow_into_nonsense) {
  PositionEstimator estimator{EstimatorSettings{}};
  Eigen::Matrix3d covariance = Eigen::Vector3d(2e-12, 2e-12, 1e-11).asDiagonal();
  covariance(0, 2) += 1e-23;  // as rounding leaves it, far below the diagonal
  for (int i = 0; i < 3000; ++i) {
    const double time = i / 15.0;
    ASSERT_TRUE(estimator.measure({time, {3.5e-3, 0, 3e-3}, covariance}) || i == 0) << i;
    const auto estimate = estimator.at(time + 0.13);
    ASSERT_LT((estimate->position - Eigen::Vector3d(3.5e-3, 0, 3e-3)).norm(), 1e-6) << i;
    ASSERT_EQ((estimate->covariance - estimate->covariance.transpose()).norm() < 1e-16, true) << i;
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
