// Position servo law on an estimate (reference velocity, proportional part, disturbance cancelled),
// and its tuning from the dead time.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/estimator.h"
#include "control/pd.h"

namespace vitreo::control {

struct ServoGains {
  double proportional = 2.5;  // 1/s
  double max_speed = 2e-3;    // m/s, of the feedback alone: Kp times the error
  void check() const;         // throws std::invalid_argument naming the gain
};

/// u = (v_ref + sat(Kp (p_ref - p^)) - d) / (1 + g), less where g is uncertain: with
/// p' = d + (1 + g) u the error decays as e' = -Kp e. Reference and estimate are of the moment at
/// which the command takes effect (ServoTuning::horizon and the estimated delay from now); the
/// reference's velocity is the mean over the time for which the command holds. Only the feedback is
/// limited, to max_speed: what cancels the disturbance is limited by what the coils can do. Nothing
/// to wind up: give the velocity that the allocation left to PositionEstimator::command.
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
  double weight = 10e-6;              // N, net: at this over drag the robot sinks
  // 1/s, of the robot left alone (Earnshaw): 1/4.5 s for CoNi in 500 cSt
  double instability = 0.22;
  void check() const;  // throws std::invalid_argument naming the parameter
  /// s, from a measurement to the mean time at which what is commanded on it acts.
  double dead_time() const {
    return measurement_latency + command_delay + command_lag + period / 2;
  }
};

struct ServoTuning {
  LoopIdentity loop;            // what it is for
  PdGains pd;                   // the thesis' law, without prediction
  ServoGains gains;             // the law above, where gain and delay are known exactly
  EstimatorSettings estimator;  // for it
  double horizon = 0;           // s: how far ahead of now reference and estimate are taken
};

/// Gains and filter noise for a loop. Throws std::invalid_argument naming the parameter.
ServoTuning tune(const LoopIdentity& loop);

/// Gain and bandwidth of one step.
struct ServoSchedule {
  double proportional = 0;      // 1/s
  double bandwidth = 0;         // rad/s, of the observer of the disturbance
  double disturbance_walk = 0;  // m/s per sqrt(s), which makes that bandwidth
};

/// What the disturbance changes with.
struct ServoChanges {
  double reference_speed = 0;  // m/s, the reference's now or lately
  double command = 0;          // m/s, of the command behind the lag, from one step to the next
};

/// As fast as what is known of the loop allows, and no faster than what has to be followed asks
/// for (docs/control.md).
ServoSchedule schedule(const ServoTuning& tuning, const PositionEstimate& estimate,
                       const ServoChanges& changes);

}  // namespace vitreo::control
