// A dense Kalman filter of eight states whose commands are sums of steps, beside the estimator.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/estimator.h"

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <tuple>
#include <utility>
#include <vector>

namespace vitreo::control::reference {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

/// The commanded velocity as a sum of steps, each with its own response: no marching from command
/// to command. A step older than twenty lags has arrived, as CommandHistory says.
struct Steps {
  double delay = 0, lag = 0;
  Vector3d before{0, 0, 0};
  std::vector<std::pair<double, Vector3d>> list;

  Vector3d sum(double from, double to, bool moved) const {
    const auto rise = [&](double age) { return age <= 0 ? 0 : -std::expm1(-age / lag); };
    const auto run = [&](double age) { return age <= 0 ? 0 : age - lag * rise(age); };
    Vector3d result = before * (moved ? to - from : 1), last = before;
    for (const auto& [time, velocity] : list) {
      const double a = from - delay - time, b = to - delay - time;
      const bool arrived = a > 20 * lag;
      const double share = moved ? (arrived ? b - a : run(b) - run(a)) : (arrived ? 1 : rise(b));
      result += (velocity - last) * share;
      last = velocity;
    }
    return result;
  }
  Vector3d moved(double from, double to) const { return sum(from, to, true); }
};

/// The filter of docs/control.md in dense matrices, its covariance updated by P - K S K'.
struct Filter {
  EstimatorSettings s;
  Steps steps;
  double time = 0;
  VectorXd x = VectorXd::Zero(8);
  MatrixXd P = MatrixXd::Zero(8, 8);
  Vector3d innovation{0, 0, 0};
  Matrix3d S = Matrix3d::Zero(), position_gain = Matrix3d::Zero(), velocity_gain = Matrix3d::Zero();
  bool at_bound = false;
  // At a bound, of the standard deviation at the start. The header's at_bound() says all of it.
  double share_at_bound = 0.2;

  explicit Filter(const EstimatorSettings& settings) : s(settings) {
    steps.delay = s.command_delay;
    steps.lag = s.command_lag;
  }
  /// `disturbance`: m^2/s^2, its covariance. State but for the position is kept.
  void start(const PositionMeasurement& m, const Matrix3d& disturbance) {
    x.head(3) = m.position;
    P.setZero();
    P.topLeftCorner(3, 3) = m.covariance;
    P.block(3, 3, 3, 3) = disturbance;
    P(6, 6) = s.gain_sigma * s.gain_sigma;
    P(7, 7) = s.delay_sigma * s.delay_sigma;
    time = m.time;
  }
  Matrix3d initial() const {
    return Matrix3d::Identity() * s.initial_disturbance * s.initial_disturbance;
  }
  void start(const PositionMeasurement& m) {
    x.setZero();
    start(m, initial());
  }
  Vector3d commanded(double to) const { return steps.sum(time - x(7), to - x(7), false); }
  std::pair<VectorXd, MatrixXd> predict(double to) const {
    const double dt = to - time, sigma = std::sqrt(P(7, 7));
    const auto moved = [&](double tau) {
      return Vector3d((1 + x(6)) * steps.moved(time - tau, to - tau));
    };
    const Vector3d middle = moved(x(7)), later = moved(x(7) + sigma), sooner = moved(x(7) - sigma);
    VectorXd y = x;
    y.head(3) += dt * x.segment(3, 3) + middle;
    MatrixXd F = MatrixXd::Identity(8, 8);
    for (int i = 0; i < 3; ++i) F(i, 3 + i) = dt;
    F.block(0, 6, 3, 1) = steps.moved(time - x(7), to - x(7));
    if (sigma > 0) F.block(0, 7, 3, 1) = (later - sooner) / (2 * sigma);
    const Vector3d second = (later + sooner) / 2 - middle;
    MatrixXd Q = MatrixXd::Zero(8, 8);
    Q.topLeftCorner(3, 3) = second * second.transpose();
    const double walk = s.disturbance_walk * s.disturbance_walk;
    for (int i = 0; i < 3; ++i) {
      Q(i, i) += s.position_walk * s.position_walk * dt + walk * dt * dt * dt / 3;
      Q(i, 3 + i) = Q(3 + i, i) = walk * dt * dt / 2;
      Q(3 + i, 3 + i) = walk * dt;
    }
    if (s.gain_sigma > 0) Q(6, 6) = s.gain_walk * s.gain_walk * dt;  // else it is known
    if (s.delay_sigma > 0) Q(7, 7) = s.delay_walk * s.delay_walk * dt;
    return {y, F * P * F.transpose() + Q};
  }
  double gated(const PositionMeasurement& m) const {
    const auto [y, C] = predict(m.time);
    const Vector3d d = m.position - y.head(3);
    const Matrix3d allowed =
        C.topLeftCorner(3, 3) + m.covariance + Matrix3d::Identity() * s.gate_error * s.gate_error;
    return std::sqrt(d.dot(allowed.inverse() * d));
  }
  void advance(double to) {
    std::tie(x, P) = predict(to);
    time = to;
  }
  void update(const PositionMeasurement& m) {
    const Vector3d u = commanded(m.time);
    advance(m.time);
    innovation = m.position - x.head(3);
    S = P.topLeftCorner(3, 3) + m.covariance;
    const MatrixXd K = P.leftCols(3) * S.inverse();
    position_gain = K.topRows(3);
    velocity_gain = K.middleRows(3, 3) + u * K.row(6);
    x += K * innovation;
    P = (P - K * S * K.transpose()).eval();
    at_bound = false;
    bound(6, -0.85, 3, s.gain_sigma);
    bound(7, -s.command_delay, 0.25, s.delay_sigma);
    // never less certain than at the start, the correlations kept
    for (const auto& [i, most] : {std::pair{6, s.gain_sigma}, std::pair{7, s.delay_sigma}}) {
      const double sigma = std::sqrt(P(i, i));
      if (sigma <= most) continue;
      P.row(i) *= most / sigma;
      P.col(i) *= most / sigma;
    }
    const double length = x.segment(3, 3).norm();
    if (length > s.max_disturbance) x.segment(3, 3) *= s.max_disturbance / length;
  }
  /// As measured exactly at the bound, where it is beyond.
  void bound(int i, double low, double high, double sigma) {
    const double to = std::clamp(x(i), low, high);
    if (sigma == 0 || to == x(i)) return;
    const VectorXd gain = P.col(i) / P(i, i);
    x += gain * (to - x(i));
    P = (P - gain * P.row(i)).eval();
    P.row(i).setZero();
    P.col(i).setZero();
    P(i, i) = std::pow(share_at_bound * sigma, 2);
    at_bound = true;
  }
};

template <typename A, typename B>
void expect_close(const A& a, const B& b, double tolerance, const char* what) {
  EXPECT_LE((a - b).norm(), tolerance * b.norm()) << what << "\n" << a << "\nfor\n" << b;
}

inline EstimatorSettings settings() {
  EstimatorSettings s;
  s.command_delay = 0.043;
  s.command_lag = 0.017;
  s.disturbance_walk = 80e-6;
  s.position_walk = 3e-6;
  s.initial_disturbance = 2e-4;
  s.gain_sigma = 0.3;
  s.gain_walk = 7e-3;
  s.delay_sigma = 0.02;
  s.delay_walk = 9e-4;
  s.gate = 0;
  return s;
}

/// A robot of another gain and delay than believed, its estimator and the reference side by side.
struct Pair {
  explicit Pair(const EstimatorSettings& s, unsigned seed = 5)
      : filter(s), estimator(s), random(seed) {
    truth = filter.steps;
  }
  Vector3d draw(double sigma) {
    return sigma * Vector3d(normal(random), normal(random), -normal(random));
  }
  void command(double at, const Vector3d& velocity) {
    estimator.command(at, velocity);
    filter.steps.list.emplace_back(at, velocity);
    truth.list.emplace_back(at, velocity);
  }
  void before(const Vector3d& velocity) {
    estimator.set_before(velocity);
    filter.steps.before = truth.before = velocity;
  }
  /// A measurement `dt` later, with commands until a little after it.
  PositionMeasurement next(double dt) {
    while (commanded_until < time + dt + 0.08) {
      command(commanded_until, draw(command_sigma));
      commanded_until += command_interval * (1 + std::abs(normal(random)));
    }
    position += disturbance * dt + (1 + gain) * truth.moved(time - delay, time + dt - delay);
    time += dt;
    const Matrix3d root = (Matrix3d() << draw(3e-6), draw(3e-6), draw(3e-6)).finished();
    PositionMeasurement m;
    m.time = time;
    m.covariance = root * root.transpose() + 1e-12 * Matrix3d::Identity();
    m.covariance = ((m.covariance + m.covariance.transpose()) / 2).eval();
    m.position = position + draw(2e-6);
    return m;
  }
  PositionMeasurement next() { return next(0.03 + 0.05 * std::abs(normal(random))); }
  void begin() {
    const PositionMeasurement m = next(0);
    EXPECT_TRUE(estimator.measure(m));
    filter.start(m);
    compare_at(time);
  }
  void step(const PositionMeasurement& m) {
    EXPECT_TRUE(estimator.measure(m));
    filter.update(m);
    compare();
  }
  void compare_at(double at) const {
    const auto e = estimator.at(at);
    ASSERT_TRUE(e);
    const auto [x, C] = filter.predict(at);
    expect_close(e->position, Vector3d(x.head(3)), tolerance, "position");
    expect_close(e->disturbance, Vector3d(x.segment(3, 3)), tolerance, "disturbance");
    expect_close(MatrixXd(e->covariance), MatrixXd(C.topLeftCorner(6, 6)), tolerance, "covariance");
    expect_close(MatrixXd(e->covariance.topRightCorner(3, 3)), MatrixXd(C.block(0, 3, 3, 3)),
                 10 * tolerance, "correlation");
    expect_close(MatrixXd(e->covariance.bottomRightCorner(3, 3)), MatrixXd(C.block(3, 3, 3, 3)),
                 tolerance, "of the disturbance");
    EXPECT_NEAR(e->gain, x(6), tolerance);
    EXPECT_NEAR(e->gain_sigma, std::sqrt(C(6, 6)), tolerance * std::sqrt(C(6, 6)));
    EXPECT_NEAR(e->delay, x(7), tolerance * 0.1);
    EXPECT_NEAR(e->delay_sigma, std::sqrt(C(7, 7)), tolerance * std::sqrt(C(7, 7)));
    const Vector3d u = filter.commanded(at);
    EXPECT_LE((e->commanded - u).norm(), tolerance * 1e-3);
    const Vector3d rest = x.segment(3, 3) + x(6) * u;
    EXPECT_LE((e->unexplained() - rest).norm(), tolerance * 1e-3);
    EXPECT_NEAR(e->age, at - filter.time, 1e-12);
  }
  void compare() const {
    ASSERT_TRUE(estimator.innovation());
    const Innovation& i = *estimator.innovation();
    expect_close(i.value, filter.innovation, 10 * tolerance, "innovation");
    expect_close(i.covariance, filter.S, tolerance, "innovation's covariance");
    const double d2 = filter.innovation.dot(filter.S.inverse() * filter.innovation);
    EXPECT_NEAR(i.normalized, d2, 20 * tolerance * d2);
    expect_close(estimator.position_gain(), filter.position_gain, tolerance, "position gain");
    expect_close(estimator.velocity_gain(), filter.velocity_gain, tolerance, "velocity gain");
    EXPECT_EQ(estimator.at_bound(), filter.at_bound);
    for (const double ahead : {0.0, 0.011, 0.06, 0.31}) compare_at(time + ahead);
  }

  Filter filter;
  PositionEstimator estimator;
  Steps truth;
  std::mt19937_64 random;
  std::normal_distribution<double> normal;
  double time = 12.3, commanded_until = 12.05, command_interval = 0.02, command_sigma = 4e-4;
  double gain = 0.2, delay = 0.011;
  double tolerance = 1e-9;
  Vector3d disturbance{1.1e-4, -0.7e-4, 0.4e-4}, position{1e-3, -2e-3, 3e-3};
};

}  // namespace vitreo::control::reference
