// Robot identification: what the robot's own motion says of the loop's delay, of its response to
// commands, and of how fast it sinks, by batch least squares over recorded motion.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <string>
#include <vector>

namespace vitreo::control {

/// One row of a recorded stream.
struct TimedVector {
  double time = 0;                 // s
  Eigen::Vector3d value{0, 0, 0};  // m, or m/s
};

/// A stretch of motion under commands that change.
struct DrivenMotion {
  std::vector<TimedVector> measured;   // m: positions, by the time of their exposure
  std::vector<TimedVector> commanded;  // m/s: believed velocity after the limits, from its time on
  double lag = 0.0106;                 // s, first order, of the coils
  /// Throws std::invalid_argument naming what is too short, not in order or not finite.
  void check() const;
};

/// A number and how well it is known. `sigma` is of this stretch's noise and of what the model of
/// the motion leaves.
struct Identified {
  double value = 0;
  double sigma = 0;
};

/// Along one direction: p' = drift + slope (p - mean p) + gain u(t - delay) behind the lag.
struct IdentifiedResponse {
  Identified delay;     // s, from a command to the first of its effect
  Identified gain;      // true response over the believed: moment over drag
  Identified drift;     // m/s, at the mean position: what the model lacks while it holds the robot
  double residual = 0;  // m, rms
  double excitation =
      0;  // m, rms of the commanded motion: against the residual, what was to be seen
};

/// Least squares over delay (searched in [0, longest_delay]) and the linear rest. `direction`
/// (unit) is the coordinate that is taken. Throws std::invalid_argument for a direction that is
/// none, and std::domain_error where the commands did not move enough to tell: below three
/// residuals.
IdentifiedResponse identify_response(const DrivenMotion& motion, const Eigen::Vector3d& direction,
                                     double longest_delay = 0.25);

/// The coils switched off, and on again.
struct Fall {
  std::vector<TimedVector> measured;  // m, from some time before `off` until `on` and after
  double off = 0;                     // s, when zero was commanded
  double on = 0;                      // s, when the first command after it was given
};

struct IdentifiedFall {
  Identified delay;  // s, from the command to the begin of the fall
  Identified speed;  // m/s, along `direction`, once it falls: weight over drag, of no field model
  double residual = 0;  // m, rms
  int samples = 0;      // that were taken while it fell
};

/// Several falls along `direction` (unit: down), one speed and one delay. `lag`: s, first order, of
/// the force's decay: half the coils' for a soft magnet far from saturation, whose force goes with
/// the current's square. Samples from the begin of each until `on` are taken, as nothing can act
/// before. Throws as identify_response; std::domain_error where there are too few samples.
IdentifiedFall identify_fall(const std::vector<Fall>& falls, const Eigen::Vector3d& direction,
                             double lag, double longest_delay = 0.25);

}  // namespace vitreo::control
