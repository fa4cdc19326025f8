// Lack of a coil: the part of its current that is missing, what that takes from the force on a
// robot, and the most probable lack by a robot's motion.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/coil_field.h"
#include "control/robot.h"

#include <Eigen/Core>

namespace vitreo::control {

/// N: with a lack c of one coil, c linear + c^2 curved is missing from the force: the robot's
/// moment follows the field that is left. Exact at half and at the whole.
struct LostForce {
  Eigen::Vector3d linear;
  Eigen::Vector3d curved;
};
/// `whole`: the field of all coils and the background, `its` the coil's part of it.
LostForce lost_force(const Robot& robot, const FieldGradient& whole, const FieldGradient& its);

/// Sums of a signature s c + t c^2 of a coil's lack c and of what was seen, v.
struct LackSums {
  double linear = 0, curved = 0;                         // s' v, t' v
  double information = 0, mixed = 0, curved_square = 0;  // s' s, s' t, t' t
  /// By which a lack c lowers the sum of squares: 2 ln of its likelihood ratio where the sums are
  /// weighted by the inverse covariance.
  double ratio(double c) const {
    return c * (2 * linear + c * (2 * curved - information - c * (2 * mixed + c * curved_square)));
  }
};

struct Lack {
  double part = 0;
  double ratio = 0;  // 0: no lack says more than none
};

/// The most probable lack in [least, most]. Where the signature is straight it is exact. A lack
/// below 0 would be a coil that carries more than it was given, which amplifiers do not.
Lack most_probable_lack(const LackSums& sums, double least, double most);

}  // namespace vitreo::control
