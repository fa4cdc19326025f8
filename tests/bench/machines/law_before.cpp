// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/machines/law_before.h"

#include "control/preconditions.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>

namespace vitreo::control::before {

namespace {

// Measurements in a row that the gate may reject. The robot may really have been displaced, so the
// next one is believed.
constexpr int kMaxRejected = 2;

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
  require(not_negative(actuation_uncertainty), "actuation_uncertainty: must be at least 0");
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
  commands_.clear();
}

// `velocity` is what the limits left of the command, m/s: else a limit would look like a
// disturbance.
void PositionEstimator::command(double time, const Eigen::Vector3d& velocity) {
  commands_.add(time, velocity);
}

// Kalman prediction of the covariance over t = `span`, P := F P F' + Q(t) with F = [1 t; 0 1] in
// blocks of position and disturbance. Q is the exact integral of the continuous white noise
// (Bar-Shalom, Li & Kirubarajan 2001, 6.2.2): with q = disturbance_walk^2, r = position_walk^2
//   Q = [q t^3/3 + r t, q t^2/2; q t^2/2, q t] for each coordinate,
// so that two predictions in a row are one over the sum of their spans.
PositionEstimator::Matrix6 PositionEstimator::predicted_covariance(double span) const {
  const Eigen::Matrix3d pp = covariance_.topLeftCorner<3, 3>(),
                        pd = covariance_.topRightCorner<3, 3>(),
                        dd = covariance_.bottomRightCorner<3, 3>();
  const Eigen::Matrix3d one = Eigen::Matrix3d::Identity();
  const double walk = settings_.disturbance_walk * settings_.disturbance_walk;
  const double position_noise = settings_.position_walk * settings_.position_walk;
  Matrix6 result;
  result.topLeftCorner<3, 3>() = pp + span * (pd + pd.transpose()) + span * span * dd +
                                 (walk * span * span * span / 3 + position_noise * span) * one;
  result.topRightCorner<3, 3>() = pd + span * dd + (walk * span * span / 2) * one;
  result.bottomLeftCorner<3, 3>() = result.topRightCorner<3, 3>().transpose();
  result.bottomRightCorner<3, 3>() = dd + (walk * span) * one;
  return result;
}

// Position as measured, the disturbance's estimate kept, without correlation between them.
// What tied position to disturbance was the old position; that one is given up.
void PositionEstimator::start_at(const PositionMeasurement& measurement,
                                 const Eigen::Matrix3d& disturbance) {
  state_.head<3>() = measurement.position;
  covariance_.setZero();
  covariance_.topLeftCorner<3, 3>() = measurement.covariance;
  covariance_.bottomRightCorner<3, 3>() = disturbance;
  started_ = true;
  rejected_ = 0;
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
    // From rest a second ago, which is many lags.
    commanded_ =
        commands_.advance(Eigen::Vector3d::Zero(), measurement.time - 1, measurement.time).velocity;
    time_ = measurement.time;
    state_.setZero();
    start_at(measurement, first);
    return true;
  }
  require(measurement.time >= time_, "measurement time: runs backwards");
  const double span = measurement.time - time_;
  const CommandHistory::Motion motion = commands_.advance(commanded_, time_, measurement.time);
  // x := F x + the commanded motion, which is known; d is modelled as constant but for its noise.
  const Eigen::Vector3d predicted = state_.head<3>() + motion.moved + span * state_.tail<3>();
  Matrix6 covariance = predicted_covariance(span);
  // The model's error of a force grows with the force, so a change of the command changes the
  // disturbance: its variance grows by (s |du|)^2. Under an oscillation this raises the gain, which
  // may feed the oscillation (facts/control_limits 1).
  covariance.bottomRightCorner<3, 3>().diagonal().array() +=
      std::pow(settings_.actuation_uncertainty, 2) * (motion.velocity - commanded_).squaredNorm();
  time_ = measurement.time;
  commanded_ = motion.velocity;
  commands_.forget_before(time_);
  if (span > settings_.max_age) {
    // The old position carries no information any more; the old disturbance is still the best
    // guess.
    start_at(measurement, covariance.bottomRightCorner<3, 3>());
    return true;
  }
  return update(measurement, predicted, covariance);
}

// Kalman update with H = [1 0]: innovation y - H x, its covariance S = H P H' + R, the gain
// K = P H' S^-1, and then x += K (y - H x).
// A rejected measurement leaves the prediction with its grown covariance.
bool PositionEstimator::update(const PositionMeasurement& measurement,
                               const Eigen::Vector3d& predicted, const Matrix6& covariance) {
  const Eigen::Vector3d innovation = measurement.position - predicted;
  const Eigen::Matrix3d innovation_covariance =
      covariance.topLeftCorner<3, 3>() + measurement.covariance;
  const Eigen::LLT<Eigen::Matrix3d> solver(innovation_covariance);
  // The gate on the Mahalanobis distance of the innovation. gate_error stands for the model's
  // error: a tracker that is sure to a micrometer must not make the gate as narrow as that.
  const Eigen::Matrix3d allowed =
      innovation_covariance + std::pow(settings_.gate_error, 2) * Eigen::Matrix3d::Identity();
  if (settings_.gate > 0 &&
      innovation.dot(allowed.llt().solve(innovation)) > settings_.gate * settings_.gate) {
    state_.head<3>() = predicted;
    covariance_ = covariance;
    if (++rejected_ <= kMaxRejected) return false;
    // The model was wrong about the disturbance too, not only about the position: were its
    // covariance kept, the next measurements would be rejected as well, and so on for ever.
    const Eigen::Matrix3d first =
        std::pow(settings_.initial_disturbance, 2) * Eigen::Matrix3d::Identity();
    start_at(measurement, covariance.bottomRightCorner<3, 3>() + first);
    return true;
  }
  rejected_ = 0;
  // K' = S^-1 (H P), P being symmetric.
  const Eigen::Matrix<double, 6, 3> gain = solver.solve(covariance.topRows<3>()).transpose();
  state_.head<3>() = predicted;
  state_ += gain * innovation;
  // Anti-windup: a robot that is held fast looks like an ever larger disturbance.
  const double disturbance = state_.tail<3>().norm();
  if (disturbance > settings_.max_disturbance)
    state_.tail<3>() *= settings_.max_disturbance / disturbance;
  // Joseph form, P := (1 - K H) P (1 - K H)' + K R K': positive whatever the rounding of K.
  Matrix6 keep = Matrix6::Identity();
  keep.leftCols<3>() -= gain;
  const Matrix6 joseph =
      keep * covariance * keep.transpose() + gain * measurement.covariance * gain.transpose();
  // It keeps a symmetric P symmetric only up to rounding, and an antisymmetric part, from there or
  // from R, would grow.
  covariance_ = (joseph + joseph.transpose()) / 2;
  return true;
}

// Prediction only: the delayed commands that have taken effect by `time` are known exactly, and the
// disturbance is held (the structure of a Smith predictor, with the model's error in d).
// Const: asking for the future changes nothing, so the loop may ask twice, for now and for the
// moment at which its command acts.
std::optional<PositionEstimate> PositionEstimator::at(double time) const {
  require(std::isfinite(time), "time: not finite");
  if (!started_) return std::nullopt;
  require(time >= time_, "time: before the last measurement");
  const double span = time - time_;
  if (span > settings_.max_age) return std::nullopt;
  PositionEstimate estimate;
  estimate.position =
      state_.head<3>() + commands_.advance(commanded_, time_, time).moved + span * state_.tail<3>();
  estimate.disturbance = state_.tail<3>();
  estimate.covariance = predicted_covariance(span);
  estimate.age = span;
  return estimate;
}

void ServoGains::check() const {
  require(not_negative(proportional), "proportional: must be at least 0 1/s");
  require(positive(max_speed), "max_speed: must be above 0 m/s");
}

// u = v_ref + Kp (p_ref - p^) - d^, shortened to max_speed (facts/magnetics 2): with p' = u + d the
// error decays as e' = -Kp e.
// The shortened velocity keeps its direction: a limit must not bend the path.
Eigen::Vector3d servo_velocity(const ServoGains& gains, const Reference& reference,
                               const PositionEstimate& estimate) {
  gains.check();
  require(reference.position.allFinite() && reference.velocity.allFinite(),
          "reference: not finite");
  const Eigen::Vector3d asked = reference.velocity +
                                gains.proportional * (reference.position - estimate.position) -
                                estimate.disturbance;
  const double speed = asked.norm();
  return speed > gains.max_speed ? Eigen::Vector3d(asked * (gains.max_speed / speed)) : asked;
}

void LoopIdentity::check() const {
  require(not_negative(measurement_latency), "measurement_latency: must be at least 0 s");
  require(not_negative(command_delay), "command_delay: must be at least 0 s");
  require(not_negative(command_lag), "command_lag: must be at least 0 s");
  require(positive(period), "period: must be above 0 s");
  require(positive(noise), "noise: must be above 0 m");
  require(positive(drag), "drag: must be above 0 N s/m");
  require(positive(force_limit), "force_limit: must be above 0 N");
  require(not_negative(instability), "instability: must be at least 0 1/s");
}

// Gains from the dead time T of the loop: latency of the measurement, delay and lag of the coils,
// and half a period, the mean age of a held command. The plant is an integrator, p' = u.
// All from the identified parameters, so that a faster camera or a thicker medium needs no tuning
// by hand.
ServoTuning tune(const LoopIdentity& loop) {
  loop.check();
  ServoTuning tuning;
  const double dead =
      loop.measurement_latency + loop.command_delay + loop.command_lag + loop.period / 2;
  // Without prediction: L(s) = Kp e^(-sT) / s crosses at w = Kp with the phase margin
  // 90 deg - Kp T, that is 61 deg at Kp T = 0.5. At 0.35 (70 deg) there is room for a drag that is
  // not as believed.
  tuning.pd.proportional = 0.35 / dead;
  tuning.pd.derivative = 0.05;
  tuning.pd.derivative_time = std::max(dead, loop.period);
  tuning.gains.max_speed = tuning.pd.max_speed = loop.force_limit / loop.drag;
  // With prediction the dead time is out of the loop but for its error; noise limits the gain.
  tuning.gains.proportional = 0.5 / dead;
  EstimatorSettings& estimator = tuning.estimator;
  estimator.command_delay = loop.command_delay;
  estimator.command_lag = loop.command_lag;
  // Process noise q: a displacement of the noise's size grows at the rate of Earnshaw's instability
  // (1/s), which is a disturbance of instability * noise (m/s) after each dead time, here with a
  // margin of ten.
  estimator.disturbance_walk = std::max(loop.instability, 0.02) * 10 * loop.noise / std::sqrt(dead);
  estimator.position_walk = 0.1 * loop.noise / std::sqrt(dead);
  // A disturbance above the speed limit could not be cancelled.
  estimator.max_disturbance = tuning.gains.max_speed;
  estimator.max_age = std::max(1.0, 4 * dead);
  // What is commanded now acts after delay and lag: reference and estimate are taken there.
  tuning.horizon = loop.command_delay + loop.command_lag;
  return tuning;
}

}  // namespace vitreo::control::before
