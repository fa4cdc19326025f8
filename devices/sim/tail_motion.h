// Motion of a swimmer with a flexible tail: head and bending filament in a field that swings.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/flexible_tail.h"
#include "devices/sim/body.h"

#include <Eigen/Core>

namespace vitreo::sim {

/// Elastohydrodynamics of a slender filament at small slopes against the head's axis (Wiggins &
/// Goldstein 1998, Phys. Rev. Lett. 80, 3879; the thrust by its local drag, Lauga 2007, Phys. Rev.
/// E 75, 041916): zeta_n (dh/dt + motion of the head's frame) = -A h'''', clamped to the head and
/// free at the end, by the first four modes of a clamped beam. Head and frame turn by any angle;
/// drag is Gray and Hancock's, without what the parts do to each other through the fluid.
class TailMotion {
 public:
  /// `viscosity` in Pa s, `moment` in A m^2. Throws std::invalid_argument naming the parameter.
  TailMotion(const control::FlexibleTail& tail, double viscosity, double moment);
  struct Step {
    Eigen::Vector3d swum;    // m, besides what a force does on a straight body that does not turn
    Eigen::Vector3d turned;  // rad, a rotation vector
  };
  /// Turns and bends the body in the field (T) for `span` s under a force (N, world) at its head.
  Step turn(BodyState& body, const Eigen::Vector3d& field, const Eigen::Vector3d& force,
            double span);
  void straighten();  ///< a newly inserted robot is straight
  Eigen::Vector3d moment(const BodyState& body) const { return moment_ * body.axis; }  // A m^2
  /// m, world: of a point of the filament at `part` (0 to 1) of its length, beside the axis.
  Eigen::Vector3d deflection(double part) const;
  const control::TailDrag& drag() const { return drag_; }

 private:
  static constexpr int kModes = 4;
  static constexpr int kUnknowns = 2 + kModes;
  // One column a direction of the world, each across the axis: velocity of its position (m/s), rate
  // of the axis (1/s), rates of the modes (m/s).
  using Rates = Eigen::Matrix<double, kUnknowns, 3>;
  using Square = Eigen::Matrix<double, kUnknowns, kUnknowns>;
  Rates rates(const BodyState& body, const Eigen::Vector3d& field, const Eigen::Vector3d& force,
              double half) const;
  double thrust(const Rates& rates, const Eigen::Matrix<double, kModes, 3>& modes) const;
  void assemble();

  control::FlexibleTail tail_;
  control::TailDrag drag_;
  double moment_;                                    // A m^2
  Square resistance_;                                // symmetric
  Eigen::Matrix<double, kModes, 1> stiffness_;       // N/m
  Eigen::Matrix<double, kUnknowns, kModes> slopes_;  // velocity times slope, over the filament
  Eigen::Matrix<double, kModes, 1> areas_;           // m, of each mode over the filament
  Eigen::Matrix<double, kModes, 3> modes_;           // m, of each mode, world
};

}  // namespace vitreo::sim
