// Steering of a robot in a rotating or oscillating field: the field's axis and frequency for a
// wanted velocity.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/rotating_field.h"
#include "control/speed_curve.h"

#include <Eigen/Core>

namespace vitreo::control {

struct SwimSettings {
  RotatingMode mode = RotatingMode::helix;
  double advance = 30e-6;  // m/rad: speed over rate, as believed (HelixResistance::advance, or the
                           // radius that rolls); negative: a left-handed helix
  double turn_rate = 2;    // rad/s by which the axis turns at most: the robot follows it
  double frequency = 10;   // Hz, the fastest
  // Of the mode oscillating, in place of `advance`:
  double swing = 0.7;  // rad, of the field at full speed
  const SpeedCurve* speeds =
      nullptr;         // measured at that swing; null: none, it only turns. Borrowed
  void check() const;  // throws std::invalid_argument naming the setting
};

struct SwimCommand {
  Eigen::Vector3d axis{1, 0, 0};      // unit, of the field's rotation
  double frequency = 0;               // Hz; negative: the other way round
  Eigen::Vector3d velocity{0, 0, 0};  // m/s, that they give a robot that turns with the field
  double swing = 0;                   // rad, of the mode oscillating
};

/// Nearest to `velocity` (m/s, through the fluid: the sinking already taken off). helix: along the
/// axis, which turns towards the velocity or against it, whichever is nearer; what of the velocity
/// is not along the axis reached is not asked for, so that a turn does not go aside.
/// oscillating: the same, forwards alone; the frequency is that of the speed on the measured curve,
/// and below the curve's lowest the swing is smaller, as thrust goes with its square (Lauga 2007).
/// roller, tumbler: v = w x (R n), n the wall's `normal` towards the robot; what goes into the wall
/// is left out. `before`: the axis until now; `span`: s since.
SwimCommand swim(const SwimSettings& settings, const Eigen::Vector3d& velocity,
                 const Eigen::Vector3d& normal, const Eigen::Vector3d& before, double span);

}  // namespace vitreo::control
