// Position estimator: a Kalman filter on the robot's position and disturbance velocity, and on what
// the model has wrong of the loop: its gain and its delay.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/command_history.h"

#include <Eigen/Core>

#include <optional>

namespace vitreo::control {

struct EstimatorSettings {
  double command_delay = 0.05;        // s, from a command to the first of its effect
  double command_lag = 0.0106;        // s, of the coils: 15 Hz
  double disturbance_walk = 60e-6;    // m/s per sqrt(s): how fast the model's error changes
  double position_walk = 1e-6;        // m per sqrt(s): unmodelled motion
  double initial_disturbance = 3e-4;  // m/s, standard deviation before anything was measured
  // m/s: held below, so that a robot held fast winds nothing up. Far above what a free robot shows.
  double max_disturbance = 6e-3;
  // Relative: standard deviation, before anything was measured, of the true gain (moment over drag)
  // against the believed one. 0: it is known.
  double gain_sigma = 0;
  double gain_walk = 4e-3;   // per sqrt(s)
  double delay_sigma = 0;    // s, the same of the delay; 0: it is known
  double delay_walk = 5e-4;  // s per sqrt(s)
  // s without a measurement after which nothing is told; the disturbance is kept for the next one
  double max_age = 1;
  double gate_error = 20e-6;  // m: of the model, added to what the gate allows
  // standard deviations beyond which a measurement is rejected; 0: never. Wide: at a corner a wrong
  // model makes innovations of many
  double gate = 20;
  void check() const;  // throws std::invalid_argument naming the setting
};

/// A measured position: taken at `time`, whenever it arrives.
struct PositionMeasurement {
  double time = 0;                                           // s
  Eigen::Vector3d position{0, 0, 0};                         // m, world
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();  // m^2
};

struct PositionEstimate {
  Eigen::Vector3d position{0, 0, 0};     // m, world
  Eigen::Vector3d disturbance{0, 0, 0};  // m/s: d in p' = d + (1 + gain) u
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();  // of both
  double gain = 0;         // the true response to a command is 1 + gain of the believed one
  double gain_sigma = 0;   // its standard deviation
  double delay = 0;        // s: the true delay less the believed one
  double delay_sigma = 0;  // s
  Eigen::Vector3d commanded{0, 0, 0};  // m/s: u behind delay and lag, at the time of the estimate
  double age = 0;                      // s since the last measurement was taken
  /// m/s: the robot's velocity beyond the commanded one.
  Eigen::Vector3d unexplained() const { return disturbance + gain * commanded; }
};

/// What the last measurement said.
struct Innovation {
  Eigen::Vector3d value{0, 0, 0};                            // m: measured less predicted
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();  // m^2, that the filter gives it
  double normalized = 0;  // squared Mahalanobis distance; 3 in the mean where the filter is right
};

/// The last update, linearized: an error e of the state became e := (1 - K H) F e - bounded, with
/// F = [1, t 1, by_gain, by_delay; 0, 1, 0, 0; ...]. Of the span since the last measurement, also
/// where that one was rejected.
struct EstimatorUpdate {
  // K, a column a coordinate of the innovation: 3 rows of position, 3 of disturbance (1/s), gain
  // (1/m), delay (s/m).
  Eigen::Matrix<double, 8, 3> gain = Eigen::Matrix<double, 8, 3>::Zero();
  Eigen::Vector3d by_gain{0, 0, 0};   // m: the commanded motion
  Eigen::Vector3d by_delay{0, 0, 0};  // m/s
  // What the bounds of gain, delay and disturbance added to the state.
  Eigen::Matrix<double, 8, 1> bounded = Eigen::Matrix<double, 8, 1>::Zero();
};

/// Kalman filter of x = [p; d; g; tau]:
///   p' = d + (1 + g) u(t - delay - tau),  d', g', tau' = white noise,
/// u the commanded velocity behind delay and lag, g the gain's error and tau the delay's, both
/// within wide bounds. Measurements may come late, irregularly or not at all, but in the order in
/// which they were taken: the state is of the last one's time, and any later time is predicted
/// through the buffered commands. The equations: docs/control.md.
class PositionEstimator {
 public:
  explicit PositionEstimator(const EstimatorSettings& settings);
  /// What the coils were given from `time` on: the velocity left after every limit, so that a limit
  /// winds nothing up.
  void command(double time, const Eigen::Vector3d& velocity);
  /// What acts before the first command, m/s (CommandHistory::set_before).
  void set_before(const Eigen::Vector3d& velocity) { commands_.set_before(velocity); }
  /// The disturbance's walk from now on, m/s per sqrt(s), above 0.
  void set_disturbance_walk(double walk);
  /// Throws std::invalid_argument naming what is not finite, a covariance that is not positive
  /// definite, or time that runs backwards. False: rejected, beyond the gate; the third in a row is
  /// taken as the new position.
  bool measure(const PositionMeasurement& measurement);
  /// The state at `time` (s), at or after the last measurement's, the future included. Nothing
  /// before the first measurement, and when the last is older than max_age. Throws
  /// std::invalid_argument for a time before the last measurement.
  std::optional<PositionEstimate> at(double time) const;
  /// Of the last measurement, a rejected one too; nothing where it was one to start from, the first
  /// or one after outliers.
  const std::optional<Innovation>& innovation() const { return innovation_; }
  /// Of the last update: by what m, and m/s, an innovation of 1 m changed position and velocity
  /// (disturbance and gain together); 1 and 1/s.
  const Eigen::Matrix3d& position_gain() const { return position_gain_; }
  const Eigen::Matrix3d& velocity_gain() const { return velocity_gain_; }
  const EstimatorUpdate& last_update() const { return last_update_; }
  /// Gain or delay met its bound at the last update: it is put there, with a fifth of the first
  /// standard deviation.
  bool at_bound() const { return at_bound_; }
  /// Measurements from now on lie aside by that, m: the view was corrected, the robot has not
  /// moved.
  void shift(const Eigen::Vector3d& by);
  void reset();

 private:
  static constexpr int kStates = 8;
  using State = Eigen::Matrix<double, kStates, 1>;
  using Covariance = Eigen::Matrix<double, kStates, kStates>;
  struct Prediction {
    State state;
    Covariance covariance;
    Eigen::Vector3d commanded;             // m/s at its end
    Eigen::Matrix<double, 3, 2> by_model;  // of the position, by gain and delay: EstimatorUpdate
  };
  CommandHistory::Motion commanded_motion(double time, double shift) const;
  Prediction predict(double time) const;
  bool beyond_gate(const Innovation& innovation) const;
  bool update(const PositionMeasurement& measurement, const Prediction& predicted);
  void start_at(const PositionMeasurement& measurement, const Eigen::Matrix3d& disturbance);
  void keep_in_bounds();
  void keep_certain();

  EstimatorSettings settings_;
  CommandHistory commands_;
  bool started_ = false;
  bool at_bound_ = false;
  int rejected_ = 0;  // in a row
  double time_ = 0;   // s, of the state
  State state_ = State::Zero();
  Covariance covariance_ = Covariance::Zero();
  std::optional<Innovation> innovation_;
  EstimatorUpdate last_update_;
  Eigen::Matrix3d position_gain_ = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d velocity_gain_ = Eigen::Matrix3d::Zero();
};

}  // namespace vitreo::control
