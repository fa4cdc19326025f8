// The filter's equations; see docs/control.md.
// SPDX-License-Identifier: Apache-2.0
#include "control/estimator.h"

#include <Eigen/Cholesky>

#include <cmath>
#include <stdexcept>

namespace vitreo::control {
namespace {

constexpr int kPassedOverAtMost =
    2;  // the robot may truly have been moved: the third in a row is believed

void require(bool good, const char* what) {
  if (!good) throw std::invalid_argument(what);
}

bool not_negative(double value) { return std::isfinite(value) && value >= 0; }
bool positive(double value) { return std::isfinite(value) && value > 0; }

void check(const PositionMeasurement& measurement) {
  require(std::isfinite(measurement.time), "measurement time: not finite");
  require(measurement.position.allFinite(), "measured position: not finite");
  const Eigen::Matrix3d& r = measurement.covariance;
  require(r.allFinite(), "measurement covariance: not finite");
  require((r - r.transpose()).norm() <= 1e-9 * r.norm(), "measurement covariance: not symmetric");
  require(r.llt().info() == Eigen::Success, "measurement covariance: not positive definite");
}

}  // namespace

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

void PositionEstimator::reset() {
  started_ = false;
  passed_over_ = 0;
  commands_.clear();
}

void PositionEstimator::command(double time, const Eigen::Vector3d& velocity) {
  commands_.add(time, velocity);
}

// F P F' + Q over `span`: position takes up the disturbance, which walks (white noise integrated
// exactly).
PositionEstimator::Matrix6 PositionEstimator::grown(double span) const {
  const Eigen::Matrix3d pp = covariance_.topLeftCorner<3, 3>(),
                        pd = covariance_.topRightCorner<3, 3>(),
                        dd = covariance_.bottomRightCorner<3, 3>();
  const Eigen::Matrix3d one = Eigen::Matrix3d::Identity();
  const double walk = settings_.disturbance_walk * settings_.disturbance_walk,
               place = settings_.position_walk * settings_.position_walk;
  Matrix6 result;
  result.topLeftCorner<3, 3>() = pp + span * (pd + pd.transpose()) + span * span * dd +
                                 (walk * span * span * span / 3 + place * span) * one;
  result.topRightCorner<3, 3>() = pd + span * dd + (walk * span * span / 2) * one;
  result.bottomLeftCorner<3, 3>() = result.topRightCorner<3, 3>().transpose();
  result.bottomRightCorner<3, 3>() = dd + (walk * span) * one;
  return result;
}

void PositionEstimator::start_at(const PositionMeasurement& measurement,
                                 const Eigen::Matrix3d& disturbance) {
  state_.head<3>() = measurement.position;
  covariance_.setZero();
  covariance_.topLeftCorner<3, 3>() = measurement.covariance;
  covariance_.bottomRightCorner<3, 3>() = disturbance;
  started_ = true;
  passed_over_ = 0;
}

bool PositionEstimator::measure(const PositionMeasurement& measurement) {
  check(measurement);
  const Eigen::Matrix3d first =
      std::pow(settings_.initial_disturbance, 2) * Eigen::Matrix3d::Identity();
  if (!started_) {
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
  const Eigen::Vector3d predicted = state_.head<3>() + motion.moved + span * state_.tail<3>();
  Matrix6 covariance = grown(span);
  // What the model gets wrong about a force grows with the force: a change of the command changes
  // the disturbance.
  covariance.bottomRightCorner<3, 3>().diagonal().array() +=
      std::pow(settings_.actuation_uncertainty, 2) * (motion.velocity - commanded_).squaredNorm();
  time_ = measurement.time;
  commanded_ = motion.velocity;
  commands_.forget_before(time_);
  if (span > settings_.max_age) {
    // Where it was says nothing any more; what pushed it is the best guess of what pushes it.
    start_at(measurement, covariance.bottomRightCorner<3, 3>());
    return true;
  }
  return update(measurement, predicted, covariance);
}

bool PositionEstimator::update(const PositionMeasurement& measurement,
                               const Eigen::Vector3d& predicted, const Matrix6& covariance) {
  const Eigen::Vector3d surprise = measurement.position - predicted;
  const Eigen::Matrix3d sum = covariance.topLeftCorner<3, 3>() + measurement.covariance;
  const Eigen::LLT<Eigen::Matrix3d> solver(sum);
  // A sure tracker's micrometers are not what the model errs by: beyond the gate is a leap, not a
  // push.
  const Eigen::Matrix3d allowed =
      sum + std::pow(settings_.gate_error, 2) * Eigen::Matrix3d::Identity();
  if (settings_.gate > 0 &&
      surprise.dot(allowed.llt().solve(surprise)) > settings_.gate * settings_.gate) {
    state_.head<3>() = predicted;
    covariance_ = covariance;
    if (++passed_over_ <= kPassedOverAtMost) return false;
    // The model was wrong about what pushes it, not only about where it is: were that kept, the
    // next would be passed over too, and so on for ever.
    const Eigen::Matrix3d first =
        std::pow(settings_.initial_disturbance, 2) * Eigen::Matrix3d::Identity();
    start_at(measurement, covariance.bottomRightCorner<3, 3>() + first);
    return true;
  }
  passed_over_ = 0;
  const Eigen::Matrix<double, 6, 3> gain =
      solver.solve(covariance.topRows<3>()).transpose();  // P H' (H P H' + R)^-1
  state_.head<3>() = predicted;
  state_ += gain * surprise;
  const double push = state_.tail<3>().norm();
  if (push > settings_.max_disturbance) state_.tail<3>() *= settings_.max_disturbance / push;
  // Joseph's form: stays positive for good, whatever the rounding.
  Matrix6 keep = Matrix6::Identity();
  keep.leftCols<3>() -= gain;
  const Matrix6 joseph =
      keep * covariance * keep.transpose() + gain * measurement.covariance * gain.transpose();
  // The form keeps what is symmetric positive; what rounding, or a measurement, brings in beside it
  // would grow.
  covariance_ = (joseph + joseph.transpose()) / 2;
  return true;
}

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
  estimate.covariance = grown(span);
  estimate.age = span;
  return estimate;
}

}  // namespace vitreo::control
