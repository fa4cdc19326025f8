// The law of 2026-11, before its margins were known: a Kalman filter with an actuation uncertainty
// and one cap of 2 mm/s. Kept as it was, for the benchmark to compare with.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/command_history.h"
#include "control/estimator.h"
#include "control/pd.h"

#include <Eigen/Core>

#include <optional>

namespace vitreo::control::before {

struct EstimatorSettings {
  double command_delay = 0.05;      // s, from a command to the first of its effect
  double command_lag = 0.0106;      // s, of the coils: 15 Hz
  double disturbance_walk = 60e-6;  // m/s per sqrt(s): how fast the model's error changes
  // relative standard deviation of the response to a change of the command
  double actuation_uncertainty = 0.2;
  double position_walk = 1e-6;        // m per sqrt(s): unmodelled motion
  double initial_disturbance = 3e-4;  // m/s, standard deviation before anything was measured
  double max_disturbance = 2e-3;      // m/s: held below, so that a robot held fast winds nothing up
  double max_age = 1;                 // s without a measurement after which nothing is known
  double gate_error = 20e-6;          // m: of the model, added to what the gate allows
  // standard deviations beyond which a measurement is rejected; 0: never. Wide: at a corner a wrong
  // model makes innovations of many
  double gate = 20;
  void check() const;  // throws std::invalid_argument naming the setting
};

struct PositionEstimate {
  Eigen::Vector3d position{0, 0, 0};     // m, world
  Eigen::Vector3d disturbance{0, 0, 0};  // m/s: the robot's velocity beyond the commanded
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();  // of both
  double age = 0;  // s since the last measurement was taken
};

/// Kalman filter of x = [p; d], p' = u + d, d' = white noise; u is the commanded velocity behind
/// delay and lag. Measurements may come late, irregularly or not at all, but in the order in which
/// they were taken: the state is of the last one's time, and any later time is predicted through
/// the buffered commands. The equations: docs/control.md.
class PositionEstimator {
 public:
  explicit PositionEstimator(const EstimatorSettings& settings);
  /// What the coils were given from `time` on: the velocity left after every limit, so that a limit
  /// winds nothing up.
  void command(double time, const Eigen::Vector3d& velocity);
  /// Throws std::invalid_argument naming what is not finite, a covariance that is not positive
  /// definite, or time that runs backwards. False: rejected, beyond the gate; the third in a row is
  /// taken as the new position.
  bool measure(const PositionMeasurement& measurement);
  /// The state at `time` (s), at or after the last measurement's, the future included. Nothing
  /// before the first measurement, and when the last is older than max_age. Throws
  /// std::invalid_argument for a time before the last measurement.
  std::optional<PositionEstimate> at(double time) const;
  void reset();

 private:
  using Vector6 = Eigen::Matrix<double, 6, 1>;
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  Matrix6 predicted_covariance(double span) const;
  bool update(const PositionMeasurement& measurement, const Eigen::Vector3d& predicted,
              const Matrix6& covariance);
  void start_at(const PositionMeasurement& measurement,
                const Eigen::Matrix3d& disturbance_covariance);

  EstimatorSettings settings_;
  CommandHistory commands_;
  bool started_ = false;
  int rejected_ = 0;                    // in a row
  double time_ = 0;                     // s, of the state
  Vector6 state_ = Vector6::Zero();     // position, disturbance
  Eigen::Vector3d commanded_{0, 0, 0};  // m/s behind the lag, at time_
  Matrix6 covariance_ = Matrix6::Zero();
};

struct ServoGains {
  double proportional = 2.5;  // 1/s
  double max_speed = 2e-3;    // m/s, of the velocity asked for
  void check() const;         // throws std::invalid_argument naming the gain
};

/// u = v_ref + Kp (p_ref - p^) - d, its length at most max_speed. Reference and estimate are of the
/// moment at which the command takes effect (ServoTuning::horizon from now); the reference's
/// velocity is the mean over the time for which the command holds. Nothing to wind up: give the
/// velocity that the allocation left to PositionEstimator::command.
Eigen::Vector3d servo_velocity(const ServoGains& gains, const Reference& reference,
                               const PositionEstimate& estimate);

/// Identified parameters of a servo loop.
struct LoopIdentity {
  double measurement_latency = 0.13;  // s, from exposure to the command that knows of it
  double command_delay = 0.05;        // s
  double command_lag = 0.0106;        // s
  double period = 1.0 / 15;           // s, of the frames
  double noise = 4.3e-6;              // m, of one coordinate of one measurement
  double drag = 6.3e-3;               // N s/m
  double force_limit = 20e-6;         // N, to spare for motion
  // 1/s, of the robot left alone (Earnshaw): 1/4.5 s for CoNi in 500 cSt
  double instability = 0.22;
  void check() const;  // throws std::invalid_argument naming the parameter
};

struct ServoTuning {
  PdGains pd;                   // the thesis' law, without prediction
  ServoGains gains;             // the law above
  EstimatorSettings estimator;  // for it
  double horizon = 0;           // s: how far ahead of now reference and estimate are taken
};

/// Gains and filter noise for a loop. Throws std::invalid_argument naming the parameter.
ServoTuning tune(const LoopIdentity& loop);

}  // namespace vitreo::control::before
