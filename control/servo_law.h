// Position servo law on an estimate (reference velocity, proportional part, disturbance cancelled),
// and its tuning from the dead time.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/estimator.h"
#include "control/pd.h"

namespace vitreo::control {

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

/// A trajectory's position at `time` and its mean velocity over the `hold` after it.
template <typename Trajectory>
Reference held_reference(const Trajectory& trajectory, double time, double hold) {
  Reference reference = trajectory.at(time);
  if (hold > 0)
    reference.velocity = (trajectory.at(time + hold).position - reference.position) / hold;
  return reference;
}

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

}  // namespace vitreo::control
