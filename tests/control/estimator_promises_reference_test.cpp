// PositionEstimator's settings, refusals, gate, age and reset against its header's words.
// SPDX-License-Identifier: Apache-2.0
#include "control/estimator.h"

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kTiny = std::numeric_limits<double>::denorm_min();

/// What the call throws as std::invalid_argument says; "" where it throws nothing.
std::string refusal(const std::function<void()>& call) {
  try {
    call();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

PositionMeasurement measurement(double time, const Vector3d& position) {
  PositionMeasurement m;
  m.time = time;
  m.position = position;
  m.covariance << 9e-12, 2e-12, -1e-12, 2e-12, 6e-12, 1e-12, -1e-12, 1e-12, 2e-11;
  return m;
}

EstimatorSettings settings() {
  EstimatorSettings s;
  s.gain_sigma = 0.3;
  s.delay_sigma = 0.02;
  s.gate = 7;
  s.max_age = 0.5;
  return s;
}

/// An estimator that has been given commands and five measurements, from 3 s to 3.4 s.
PositionEstimator in_use(const EstimatorSettings& s = settings()) {
  PositionEstimator estimator(s);
  for (int k = 0; k < 20; ++k) {
    estimator.command(2.5 + 0.05 * k, Vector3d(std::sin(k), std::cos(2 * k), 0.4) * 2e-4);
  }
  for (int k = 0; k < 5; ++k) {
    estimator.measure(measurement(3 + 0.1 * k, Vector3d(1, -0.5 * k, 2 * k) * 1e-5));
  }
  return estimator;
}

void expect_same(const PositionEstimator& a, const PositionEstimator& b, double from) {
  for (const double ahead : {0.0, 0.17, 0.43}) {
    const auto x = a.at(from + ahead), y = b.at(from + ahead);
    ASSERT_TRUE(x);
    ASSERT_TRUE(y);
    EXPECT_EQ(x->position, y->position);
    EXPECT_EQ(x->disturbance, y->disturbance);
    EXPECT_EQ(x->covariance, y->covariance);
    EXPECT_EQ(x->gain, y->gain);
    EXPECT_EQ(x->gain_sigma, y->gain_sigma);
    EXPECT_EQ(x->delay, y->delay);
    EXPECT_EQ(x->delay_sigma, y->delay_sigma);
    EXPECT_EQ(x->commanded, y->commanded);
    EXPECT_EQ(x->age, y->age);
  }
}

TEST(PositionEstimatorPromises, every_setting_is_checked_on_both_sides) {
  struct Setting {
    double EstimatorSettings::*value;
    const char* message;
    bool zero;    // allowed
    double most;  // allowed
  };
  using S = EstimatorSettings;
  const double any = 1e300;
  for (const Setting& setting : {
           Setting{&S::command_delay, "command_delay: must be at least 0 s", true, any},
           Setting{&S::command_lag, "command_lag: must be at least 0 s", true, any},
           Setting{&S::disturbance_walk, "disturbance_walk: must be above 0 m/s per sqrt(s)", false,
                   any},
           Setting{&S::position_walk, "position_walk: must be at least 0 m per sqrt(s)", true, any},
           Setting{&S::initial_disturbance, "initial_disturbance: must be above 0 m/s", false, any},
           Setting{&S::max_disturbance, "max_disturbance: must be above 0 m/s", false, any},
           Setting{&S::gain_sigma, "gain_sigma: must be in [0, 1]", true, 1},
           Setting{&S::gain_walk, "gain_walk: must be at least 0 per sqrt(s)", true, any},
           Setting{&S::delay_sigma, "delay_sigma: must be in [0, 0.1] s", true, 0.1},
           Setting{&S::delay_walk, "delay_walk: must be at least 0 s per sqrt(s)", true, any},
           Setting{&S::max_age, "max_age: must be above 0 s", false, any},
           Setting{&S::gate_error, "gate_error: must be at least 0 m", true, any},
           Setting{&S::gate, "gate: must be at least 0 standard deviations", true, any},
       }) {
    const auto said = [&](double value) {
      EstimatorSettings s;
      s.*setting.value = value;
      const std::string message = refusal([&] { s.check(); });
      EXPECT_EQ(refusal([&] { PositionEstimator estimator(s); }), message);
      return message;
    };
    EXPECT_EQ(said(setting.zero ? 0 : kTiny), "") << setting.message;
    EXPECT_EQ(said(setting.most), "") << setting.message;
    for (const double bad : {setting.zero ? -kTiny : 0.0, -1e-3, -1.0, kNan, kInfinity, -kInfinity,
                             std::nextafter(setting.most, kInfinity)}) {
      if (std::isfinite(bad) && bad > setting.most && setting.most == any) continue;
      EXPECT_EQ(said(bad), setting.message) << bad;
    }
  }
}

TEST(PositionEstimatorPromises, a_bad_measurement_is_named_and_changes_nothing) {
  PositionEstimator estimator = in_use();
  const PositionEstimator before = estimator;
  const PositionMeasurement good = measurement(3.5, {1e-5, 2e-5, 3e-5});
  const auto said = [&](const std::function<void(PositionMeasurement&)>& spoil) {
    PositionMeasurement m = good;
    spoil(m);
    return refusal([&] { estimator.measure(m); });
  };
  for (const double bad : {kNan, kInfinity, -kInfinity}) {
    EXPECT_EQ(said([&](auto& m) { m.time = bad; }), "measurement time: not finite");
    for (int i = 0; i < 3; ++i) {
      EXPECT_EQ(said([&](auto& m) { m.position(i) = bad; }), "measured position: not finite");
      for (int j = 0; j < 3; ++j) {
        EXPECT_EQ(said([&](auto& m) { m.covariance(i, j) = m.covariance(j, i) = bad; }),
                  "measurement covariance: not finite");
      }
    }
  }
  const char* const indefinite = "measurement covariance: not positive definite";
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(said([&](auto& m) { m.covariance(i, i) = 0; }), indefinite);
    EXPECT_EQ(said([&](auto& m) { m.covariance(i, i) *= -1; }), indefinite);
    const int j = (i + 1) % 3;
    EXPECT_EQ(said([&](auto& m) {
                const double most = std::sqrt(m.covariance(i, i) * m.covariance(j, j));
                m.covariance(i, j) = m.covariance(j, i) = -1.01 * most;
              }),
              indefinite);
    for (const double off : {1e-15, -1e-15}) {
      EXPECT_EQ(said([&](auto& m) { m.covariance(i, j) += off; }),
                "measurement covariance: not symmetric");
      EXPECT_EQ(said([&](auto& m) { m.covariance(j, i) += off; }),
                "measurement covariance: not symmetric");
    }
  }
  EXPECT_EQ(said([](auto& m) { m.time = std::nextafter(3.4, 3); }),
            "measurement time: runs backwards");
  expect_same(estimator, before, 3.4);
  EXPECT_EQ(estimator.innovation()->value, before.innovation()->value);
  EXPECT_EQ(said([](auto&) {}), "");
}

TEST(PositionEstimatorPromises, other_bad_arguments_are_named_and_change_nothing) {
  PositionEstimator estimator = in_use();
  const PositionEstimator before = estimator;
  for (const double bad : {kNan, kInfinity, -kInfinity}) {
    EXPECT_EQ(refusal([&] { estimator.command(bad, {1, 2, 3}); }), "command time: not finite");
    for (int i = 0; i < 3; ++i) {
      Vector3d velocity(1e-4, 2e-4, 3e-4);
      velocity(i) = bad;
      EXPECT_EQ(refusal([&] { estimator.command(3.45, velocity); }),
                "commanded velocity: not finite");
    }
    EXPECT_EQ(refusal([&] { estimator.at(bad); }), "time: not finite");
    EXPECT_EQ(refusal([&] { PositionEstimator(settings()).at(bad); }), "time: not finite");
  }
  const double last = 2.5 + 0.05 * 19;
  EXPECT_EQ(refusal([&] {
              estimator.command(std::nextafter(last, 0), {1, 2, 3});
            }),
            "command time: runs backwards");
  EXPECT_EQ(refusal([&] { estimator.at(std::nextafter(3.4, 0)); }),
            "time: before the last measurement");
  for (const double bad : {0.0, -kTiny, -1.0, kNan, kInfinity, -kInfinity}) {
    EXPECT_EQ(refusal([&] { estimator.set_disturbance_walk(bad); }),
              "disturbance_walk: must be above 0 m/s per sqrt(s)");
  }
  expect_same(estimator, before, 3.4);
  EXPECT_EQ(refusal([&] { estimator.set_disturbance_walk(kTiny); }), "");
  EXPECT_EQ(refusal([&] { estimator.command(last, {1e-4, 2e-4, 3e-4}); }), "");
}

TEST(PositionEstimatorPromises, says_nothing_before_the_first_measurement_and_after_max_age) {
  PositionEstimator estimator(settings());
  EXPECT_FALSE(estimator.at(-1));
  EXPECT_FALSE(estimator.innovation());
  EXPECT_FALSE(estimator.at_bound());
  EXPECT_TRUE(estimator.measure(measurement(-7.25, {1e-3, 2e-3, 3e-3})));
  EXPECT_FALSE(estimator.innovation());  // one to start from
  EXPECT_TRUE(estimator.at(-7.25 + 0.5));
  EXPECT_FALSE(estimator.at(std::nextafter(-7.25 + 0.5, 0)));
  EXPECT_TRUE(estimator.at(-7));  // asked of the future, it knows the present as before
  EXPECT_EQ(estimator.at(-7)->age, 0.25);
  // exactly as old as max_age is not older: an update, and no start
  EXPECT_TRUE(estimator.measure(measurement(-7.25 + 0.5, {1e-3, 2e-3, 3e-3})));
  EXPECT_TRUE(estimator.innovation());
  EXPECT_TRUE(estimator.measure(measurement(-6.25 + 1e-9, {1e-3, 2e-3, 3e-3})));
  EXPECT_FALSE(estimator.innovation());
  EXPECT_NEAR(estimator.at(-6)->gain_sigma, std::hypot(0.3, 4e-3 * std::sqrt(0.25 - 1e-9)), 1e-14);
}

TEST(PositionEstimatorPromises, asking_changes_nothing) {
  PositionEstimator asked = in_use(), left = in_use();
  for (const double time : {3.4, 3.9, 3.41, 3.7, 5.0}) asked.at(time);
  const PositionMeasurement m = measurement(3.55, {2e-5, -3e-5, 9e-5});
  EXPECT_EQ(asked.measure(m), left.measure(m));
  expect_same(asked, left, 3.55);
}

TEST(PositionEstimatorPromises, gates_by_standard_deviations_of_innovation_and_model) {
  for (const double gate : {3.0, 11.0}) {
    for (const double error : {0.0, 12e-6}) {
      EstimatorSettings s = settings();
      s.gate = gate;
      s.gate_error = error;
      for (const Vector3d& towards :
           {Vector3d(1, 0, 0), Vector3d(0, -1, 0), Vector3d(0.1, 0, 1), Vector3d(-2, 1, 0.5)}) {
        const auto passes = [&](double length) {
          PositionEstimator estimator(s);
          estimator.measure(measurement(3, {0, 0, 0}));
          return estimator.measure(measurement(3.2, length * towards));
        };
        // at rest without commands: P = R + (initial d^2 + walk^2 dt / 3) dt^2 + walk of position
        const double dt = 0.2, along = (9e-8 + 3.6e-9 * dt / 3) * dt * dt + 1e-12 * dt;
        const Matrix3d allowed =
            2 * measurement(0, towards).covariance + (along + error * error) * Matrix3d::Identity();
        const double edge = gate / std::sqrt(towards.dot(allowed.ldlt().solve(towards)));
        EXPECT_TRUE(passes(edge * (1 - 1e-9)));
        EXPECT_FALSE(passes(edge * (1 + 1e-9)));
      }
    }
  }
  EstimatorSettings s = settings();
  s.gate = 0;  // never
  PositionEstimator estimator(s);
  estimator.measure(measurement(3, {0, 0, 0}));
  EXPECT_TRUE(estimator.measure(measurement(3.1, {1, -2, 3})));
  EXPECT_TRUE(estimator.innovation());
}

TEST(PositionEstimatorPromises, after_a_reset_it_begins_as_a_new_one) {
  // With two outliers counted, and at a time and with commands that a new one would refuse.
  PositionEstimator estimator = in_use();
  EXPECT_FALSE(estimator.measure(measurement(3.45, {1, 0, 0})));
  EXPECT_FALSE(estimator.measure(measurement(3.46, {1, 0, 0})));
  estimator.reset();
  EXPECT_FALSE(estimator.at(3.46));
  EXPECT_FALSE(estimator.innovation());
  PositionEstimator fresh(settings());
  for (PositionEstimator* each : {&estimator, &fresh}) {
    each->command(0.9, {1e-4, -2e-4, 3e-4});
    EXPECT_TRUE(each->measure(measurement(1, {1e-3, 2e-3, 3e-3})));
    EXPECT_FALSE(each->innovation());
  }
  expect_same(estimator, fresh, 1);
  for (PositionEstimator* each : {&estimator, &fresh}) {
    each->command(1.02, {-3e-4, 2e-4, 1e-4});
    EXPECT_TRUE(each->measure(measurement(1.1, {1.01e-3, 2.02e-3, 2.97e-3})));
    EXPECT_FALSE(each->measure(measurement(1.15, {1, 0, 0})));
    EXPECT_FALSE(each->measure(measurement(1.16, {1, 0, 0})));
  }
  expect_same(estimator, fresh, 1.16);
}

TEST(PositionEstimatorPromises, a_reset_keeps_what_acts_before_the_first_command_and_the_walk) {
  PositionEstimator estimator = in_use();
  const Vector3d fall(1e-4, -2e-4, -3e-4);
  estimator.set_before(fall);
  estimator.set_disturbance_walk(4e-4);
  estimator.reset();
  estimator.measure(measurement(1, {0, 0, 0}));
  const auto e = estimator.at(1.25);
  EXPECT_LE((e->commanded - fall).norm(), 1e-18);
  EXPECT_LE((e->position - 0.25 * fall).norm(), 1e-18);
  EXPECT_NEAR(e->covariance(4, 4), 9e-8 + 16e-8 * 0.25, 1e-20);
}

TEST(PositionEstimatorPromises, without_lag_a_command_acts_at_once_and_wholly) {
  EstimatorSettings s = settings();
  s.command_lag = 0;
  s.command_delay = 0.125;
  s.delay_sigma = 0;
  PositionEstimator estimator(s);
  estimator.measure(measurement(1, {0, 0, 0}));
  const Vector3d velocity(3e-4, -1e-4, 2e-4);
  estimator.command(1, velocity);
  EXPECT_EQ(estimator.at(1.12)->commanded, Vector3d(0, 0, 0));
  EXPECT_EQ(estimator.at(1.13)->commanded, velocity);
  EXPECT_LE((estimator.at(1.375)->position - 0.25 * velocity).norm(), 1e-18);
  EXPECT_EQ(estimator.at(1.375)->unexplained(), Vector3d(0, 0, 0));
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
