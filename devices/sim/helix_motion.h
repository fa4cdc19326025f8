// Motion of a helical swimmer: the turning of a rigid body whose moment lies across its axis, and
// what it swims meanwhile.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/coil_field.h"
#include "control/helix.h"
#include "devices/sim/body.h"

namespace vitreo::sim {

/// Overdamped: at every instant the torque m x B balances the drag of the propulsion matrix. The
/// moment lies along the body's side and turns with it.
class HelixMotion {
 public:
  /// `viscosity` in Pa s, `moment` in A m^2. Throws std::invalid_argument naming the parameter.
  HelixMotion(const control::Helix& helix, double viscosity, double moment);
  struct Step {
    Eigen::Vector3d swum;    // m, besides what a force does on a body that does not turn
    Eigen::Vector3d turned;  // rad, a rotation vector
  };
  /// Turns the body in the field (T) for `span` s under a force (N, world).
  Step turn(BodyState& body, const Eigen::Vector3d& field, const Eigen::Vector3d& force,
            double span) const;
  Eigen::Vector3d moment(const BodyState& body) const { return moment_ * body.side; }  // A m^2
  const control::HelixResistance& drag() const { return drag_; }

 private:
  Eigen::Vector3d rate(const BodyState& body, const Eigen::Vector3d& field,
                       const Eigen::Vector3d& force) const;

  control::HelixResistance drag_;
  double moment_;  // A m^2
};

}  // namespace vitreo::sim
