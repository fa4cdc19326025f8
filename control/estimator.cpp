// SPDX-License-Identifier: Apache-2.0
#include "control/estimator.h"

#include "control/preconditions.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>

namespace vitreo::control {
namespace {

// Measurements in a row that the gate may reject. The robot may really have been displaced, so the
// next one is believed.
constexpr int kMaxRejected = 2;

// Places in the state: position, disturbance, gain, delay.
constexpr int kP = 0, kD = 3, kG = 6, kTau = 7;

// Bounds of the estimated gain and delay (facts/control_limits 4): moment - 30 % in twice the drag
// is 0.35, so the bound is well below it.
constexpr double kLeastGain = -0.85;
constexpr double kMostGain = 3;
constexpr double kMostDelay = 0.25;  // s beyond the believed one
// s: the least distance over which the delay's effect is differenced.
constexpr double kSharpestDelay = 1e-3;
// Of the first standard deviation: what is left of it at a bound.
constexpr double kAtBound = 0.2;

// The covariance must be symmetric and positive definite, which the Cholesky factorization decides.
void check(const PositionMeasurement& measurement) {
  require(std::isfinite(measurement.time), "measurement time: not finite");
  require(measurement.position.allFinite(), "measured position: not finite");
  const Eigen::Matrix3d& r = measurement.covariance;
  require(r.allFinite(), "measurement covariance: not finite");
  require((r - r.transpose()).norm() <= 1e-9 * r.norm(), "measurement covariance: not symmetric");
  require(r.llt().info() == Eigen::Success, "measurement covariance: not positive definite");
}

}  // namespace

// Throws std::invalid_argument naming the setting, with the unit that is meant.
void EstimatorSettings::check() const {
  require(not_negative(command_delay), "command_delay: must be at least 0 s");
  require(not_negative(command_lag), "command_lag: must be at least 0 s");
  require(positive(disturbance_walk), "disturbance_walk: must be above 0 m/s per sqrt(s)");
  require(not_negative(position_walk), "position_walk: must be at least 0 m per sqrt(s)");
  require(positive(initial_disturbance), "initial_disturbance: must be above 0 m/s");
  require(positive(max_disturbance), "max_disturbance: must be above 0 m/s");
  require(not_negative(gain_sigma) && gain_sigma <= 1, "gain_sigma: must be in [0, 1]");
  require(not_negative(gain_walk), "gain_walk: must be at least 0 per sqrt(s)");
  require(not_negative(delay_sigma) && delay_sigma <= 0.1, "delay_sigma: must be in [0, 0.1] s");
  require(not_negative(delay_walk), "delay_walk: must be at least 0 s per sqrt(s)");
  require(positive(max_age), "max_age: must be above 0 s");
  require(not_negative(gate), "gate: must be at least 0 standard deviations");
  require(not_negative(gate_error), "gate_error: must be at least 0 m");
}

PositionEstimator::PositionEstimator(const EstimatorSettings& settings)
    : settings_((settings.check(), settings)),
      commands_(settings.command_delay, settings.command_lag) {}

// To a filter that has seen nothing; the settings stay.
void PositionEstimator::reset() {
  started_ = false;
  rejected_ = 0;
  innovation_.reset();
  commands_.clear();
}

void PositionEstimator::shift(const Eigen::Vector3d& by) { state_.head<3>() += by; }

// `velocity` is what the limits left of the command, m/s: else a limit would look like a
// disturbance.
void PositionEstimator::command(double time, const Eigen::Vector3d& velocity) {
  commands_.add(time, velocity);
}

void PositionEstimator::set_disturbance_walk(double walk) {
  require(positive(walk), "disturbance_walk: must be above 0 m/s per sqrt(s)");
  settings_.disturbance_walk = walk;
}

// From the state's time to `time`, where the delay is `shift` longer than believed.
CommandHistory::Motion PositionEstimator::commanded_motion(double time, double shift) const {
  const double from = time_ - shift;
  return commands_.advance(commands_.velocity_at(from), from, time - shift);
}

// Kalman prediction over t, x := f(x), P := F P F' + Q(t), with m the commanded motion over t
// behind delay + tau and lag:
//   p := p + t d + (1 + g) m,  F = [1, t 1, m, (1 + g) dm/dtau; 0, 1, 0, 0; ...].
// Q of p and d is the exact integral of the continuous white noise (Bar-Shalom, Li & Kirubarajan
// 2001, 6.2.2): with q = disturbance_walk^2, r = position_walk^2
//   Q = [q t^3/3 + r t, q t^2/2; q t^2/2, q t] for each coordinate,
// so that two predictions in a row are one over the sum of their spans.
PositionEstimator::Prediction PositionEstimator::predict(double time) const {
  const double span = time - time_;
  const double shift = state_[kTau];
  const double gain = 1 + state_[kG];
  const CommandHistory::Motion motion = commanded_motion(time, shift);
  Prediction next;
  next.commanded = motion.velocity;
  next.state = state_;
  next.state.segment<3>(kP) += span * state_.segment<3>(kD) + gain * motion.moved;
  // dp/dtau as the difference over its own standard deviation on either side, and what is left of
  // the second order as noise: the commands are steps, and a step that falls outside of the
  // interval at tau may well be in it (central differences; Norgaard, Poulsen & Ravn 2000).
  Eigen::Vector3d by_delay = Eigen::Vector3d::Zero();
  Eigen::Vector3d curved = Eigen::Vector3d::Zero();
  if (const double sigma = std::sqrt(covariance_(kTau, kTau)); sigma > 0) {
    const double apart = std::max(sigma, kSharpestDelay);
    const Eigen::Vector3d later = commanded_motion(time, shift + apart).moved;
    const Eigen::Vector3d sooner = commanded_motion(time, shift - apart).moved;
    by_delay = gain * (later - sooner) / (2 * apart);
    curved = gain * (later + sooner - 2 * motion.moved) / 2;
  }
  // F P, then (F P) F': F differs from 1 in the rows of the position only.
  next.by_model << motion.moved, by_delay;
  Covariance& p = next.covariance;
  p = covariance_;
  p.topRows<3>() +=
      span * covariance_.middleRows<3>(kD) + next.by_model * covariance_.bottomRows<2>();
  const Eigen::Matrix<double, kStates, 3> columns =
      span * p.middleCols<3>(kD) + p.rightCols<2>() * next.by_model.transpose();
  p.leftCols<3>() += columns;
  const double walk = settings_.disturbance_walk * settings_.disturbance_walk;
  const double position_noise = settings_.position_walk * settings_.position_walk;
  const double cross = walk * span * span / 2;
  for (int k = 0; k < 3; ++k) {
    p(kP + k, kP + k) += walk * span * span * span / 3 + position_noise * span;
    p(kP + k, kD + k) += cross;
    p(kD + k, kP + k) += cross;
    p(kD + k, kD + k) += walk * span;
  }
  p.topLeftCorner<3, 3>() += curved * curved.transpose();
  if (settings_.gain_sigma > 0) p(kG, kG) += settings_.gain_walk * settings_.gain_walk * span;
  if (settings_.delay_sigma > 0)
    p(kTau, kTau) += settings_.delay_walk * settings_.delay_walk * span;
  return next;
}

// Position as measured, the disturbance's estimate kept, without correlation between them.
// What tied position to disturbance was the old position; that one is given up. Gain and delay are
// as uncertain as before anything was measured.
void PositionEstimator::start_at(const PositionMeasurement& measurement,
                                 const Eigen::Matrix3d& disturbance) {
  state_.segment<3>(kP) = measurement.position;
  covariance_.setZero();
  covariance_.topLeftCorner<3, 3>() = measurement.covariance;
  covariance_.block<3, 3>(kD, kD) = disturbance;
  covariance_(kG, kG) = settings_.gain_sigma * settings_.gain_sigma;
  covariance_(kTau, kTau) = settings_.delay_sigma * settings_.delay_sigma;
  started_ = true;
  rejected_ = 0;
  innovation_.reset();
}

// The prediction to the measurement's time, then the update. The state is of the time at which the
// measurement was taken, not at which it arrived: latency needs no augmented state, because at()
// predicts from there through the buffered commands.
// True where the measurement was used. A gap longer than max_age starts anew from it.
bool PositionEstimator::measure(const PositionMeasurement& measurement) {
  check(measurement);
  const Eigen::Matrix3d first =
      std::pow(settings_.initial_disturbance, 2) * Eigen::Matrix3d::Identity();
  if (!started_) {
    time_ = measurement.time;
    state_.setZero();
    start_at(measurement, first);
    return true;
  }
  require(measurement.time >= time_, "measurement time: runs backwards");
  const double span = measurement.time - time_;
  const Prediction predicted = predict(measurement.time);
  time_ = measurement.time;
  commands_.forget_before(time_ - kMostDelay - commands_.memory());
  if (span > settings_.max_age) {
    // The old position carries no information any more; the old disturbance is still the best
    // guess.
    start_at(measurement, predicted.covariance.block<3, 3>(kD, kD));
    return true;
  }
  return update(measurement, predicted);
}

// The gate on the Mahalanobis distance of the innovation. gate_error stands for the model's error:
// a tracker that is sure to a micrometer must not make the gate as narrow as that.
bool PositionEstimator::beyond_gate(const Innovation& innovation) const {
  if (settings_.gate == 0) return false;
  const Eigen::Matrix3d allowed =
      innovation.covariance + std::pow(settings_.gate_error, 2) * Eigen::Matrix3d::Identity();
  return innovation.value.dot(allowed.llt().solve(innovation.value)) >
         settings_.gate * settings_.gate;
}

// Kalman update with H = [1 0 0 0]: innovation y - H x, its covariance S = H P H' + R, the gain
// K = P H' S^-1, and then x += K (y - H x).
// A rejected measurement leaves the prediction with its grown covariance.
bool PositionEstimator::update(const PositionMeasurement& measurement,
                               const Prediction& predicted) {
  Innovation innovation;
  innovation.value = measurement.position - predicted.state.segment<3>(kP);
  innovation.covariance = predicted.covariance.topLeftCorner<3, 3>() + measurement.covariance;
  const Eigen::LLT<Eigen::Matrix3d> solver(innovation.covariance);
  innovation.normalized = innovation.value.dot(solver.solve(innovation.value));
  innovation_ = innovation;
  state_ = predicted.state;
  covariance_ = predicted.covariance;
  if (beyond_gate(innovation)) {
    if (++rejected_ <= kMaxRejected) return false;
    // The model was wrong about the disturbance too, not only about the position: were its
    // covariance kept, the next measurements would be rejected as well, and so on for ever.
    const Eigen::Matrix3d first =
        std::pow(settings_.initial_disturbance, 2) * Eigen::Matrix3d::Identity();
    start_at(measurement, predicted.covariance.block<3, 3>(kD, kD) + first);
    return true;
  }
  rejected_ = 0;
  // K' = S^-1 (H P), P being symmetric.
  const Eigen::Matrix<double, kStates, 3> gain =
      solver.solve(predicted.covariance.topRows<3>()).transpose();
  position_gain_ = gain.middleRows<3>(kP);
  // d + g u is the velocity: a wrong gain at a steady command is a disturbance along it.
  velocity_gain_ = gain.middleRows<3>(kD) + predicted.commanded * gain.row(kG);
  state_ += gain * innovation.value;
  const State unbounded = state_;
  // Joseph form, P := (1 - K H) P (1 - K H)' + K R K': positive whatever the rounding of K.
  // 1 - K H differs from 1 in its first three columns.
  Covariance left = predicted.covariance - gain * predicted.covariance.topRows<3>();
  const Eigen::Matrix<double, kStates, 3> first_columns = left.leftCols<3>();
  left -= first_columns * gain.transpose();
  left += gain * measurement.covariance * gain.transpose();
  // It keeps a symmetric P symmetric only up to rounding, and an antisymmetric part, from there or
  // from R, would grow.
  covariance_ = (left + left.transpose()) / 2;
  keep_in_bounds();
  keep_certain();
  last_update_ = {gain, predicted.by_model.col(0), predicted.by_model.col(1), state_ - unbounded};
  return true;
}

// A robot that is held fast looks like an ever larger disturbance, and like a gain of zero.
// A gain or delay beyond its bound is put there as if it had been measured, x += P_k / P_kk (bound
// - x_k), so that the disturbance takes what it explained; then it is free to come back.
void PositionEstimator::keep_in_bounds() {
  at_bound_ = false;
  const auto bound = [this](int k, double least, double most, double sigma) {
    if (state_[k] >= least && state_[k] <= most) return;
    at_bound_ = true;
    const double variance = covariance_(k, k);
    if (variance > 0) {
      const State tied = covariance_.col(k) / variance;
      state_ += tied * (std::clamp(state_[k], least, most) - state_[k]);
      covariance_ -= tied * variance * tied.transpose();
    }
    state_[k] = std::clamp(state_[k], least, most);
    covariance_.row(k).setZero();
    covariance_.col(k).setZero();
    covariance_(k, k) = sigma * sigma;
  };
  bound(kG, kLeastGain, kMostGain, kAtBound * settings_.gain_sigma);
  bound(kTau, -settings_.command_delay, kMostDelay, kAtBound * settings_.delay_sigma);
  state_[kG] = std::clamp(state_[kG], kLeastGain, kMostGain);  // the delay's bound may move it
  const double disturbance = state_.segment<3>(kD).norm();
  if (disturbance > settings_.max_disturbance)
    state_.segment<3>(kD) *= settings_.max_disturbance / disturbance;
}

// Gain and delay are never less certain than before anything was measured. Row and column are
// scaled, which keeps the correlations and P positive definite.
void PositionEstimator::keep_certain() {
  const auto keep = [this](int k, double sigma) {
    const double variance = covariance_(k, k);
    if (!(variance > sigma * sigma)) return;
    const double part = sigma / std::sqrt(variance);
    covariance_.row(k) *= part;
    covariance_.col(k) *= part;
  };
  keep(kG, settings_.gain_sigma);
  keep(kTau, settings_.delay_sigma);
}

// Prediction only: the delayed commands that have taken effect by `time` are known exactly, and the
// disturbance is held (the structure of a Smith predictor, with the model's error in d, g and tau).
// Const: asking for the future changes nothing, so the loop may ask twice, for now and for the
// moment at which its command acts.
std::optional<PositionEstimate> PositionEstimator::at(double time) const {
  require(std::isfinite(time), "time: not finite");
  if (!started_) return std::nullopt;
  require(time >= time_, "time: before the last measurement");
  const double span = time - time_;
  if (span > settings_.max_age) return std::nullopt;
  const Prediction ahead = predict(time);
  PositionEstimate estimate;
  estimate.position = ahead.state.segment<3>(kP);
  estimate.disturbance = ahead.state.segment<3>(kD);
  estimate.covariance = ahead.covariance.topLeftCorner<6, 6>();
  estimate.gain = ahead.state[kG];
  estimate.gain_sigma = std::sqrt(ahead.covariance(kG, kG));
  estimate.delay = ahead.state[kTau];
  estimate.delay_sigma = std::sqrt(ahead.covariance(kTau, kTau));
  estimate.commanded = ahead.commanded;
  estimate.age = span;
  return estimate;
}

}  // namespace vitreo::control
