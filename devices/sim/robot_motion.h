// Robot motion in its medium: one step of the overdamped turning and drifting.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/coil_field.h"
#include "control/robot.h"
#include "control/vitreous.h"
#include "devices/sim/body.h"
#include "devices/sim/helix_motion.h"
#include "devices/sim/tail_motion.h"

#include <optional>

namespace vitreo::sim {

/// Inertia is left out: mass over drag is 0.5 ms at most in oil of 500 cSt (facts/magnetics 3.1),
/// half a step.
class RobotMotion {
 public:
  /// In a gel when there is one, otherwise in the fluid. Throws std::invalid_argument naming a
  /// parameter.
  RobotMotion(const control::Robot& robot, const control::Medium& fluid,
              const std::optional<control::Gel>& gel, double moment_gain);
  struct Step {
    Eigen::Vector3d moved;   // m
    Eigen::Vector3d turned;  // rad, a rotation vector
  };
  /// Moves and turns `body` by one step of `span` s in the field given (at the body's position; T,
  /// T/m). `extra_force`: N, on top of field and weight. Turning: torque m x B against Perrin's
  /// rotational drag, the axis' way to the field taken exactly for a torque that falls with the
  /// angle (implicitly in a gel), so that no step overshoots. Where the field wants it turned by
  /// just 180 degrees (a soft robot: 90), it is a ten-thousandth of a radian off: nothing real
  /// balances. Drifting: Perrin's drag with Faxen's factors for the retina and the lens when
  /// `cavity` is given; walls do not stiffen a gel. A helix: HelixMotion;
  /// a flexible tail: TailMotion.
  Step step(BodyState& body, const control::FieldGradient& field,
            const Eigen::Vector3d& extra_force, const Cavity* cavity, double span);
  double net_weight() const { return net_weight_; }  // N, downwards
  void relax();  ///< a newly inserted robot sits in an unstressed gel, and its tail is straight
  const control::EmbeddedRobot* gel() const { return embedded_ ? &*embedded_ : nullptr; }

 private:
  Step swim(BodyState& body, const control::FieldGradient& field,
            const Eigen::Vector3d& extra_force, const Cavity* cavity, double span);
  Eigen::Vector3d rolled(const BodyState& body, const Eigen::Vector3d& turned,
                         const Cavity& cavity) const;
  Eigen::Vector3d moment(const BodyState& body, const Eigen::Vector3d& field) const;
  Eigen::Vector3d velocity(const BodyState& body, const Eigen::Vector3d& force,
                           const Cavity* cavity) const;

  control::Robot robot_;
  double moment_gain_;
  std::optional<control::EmbeddedRobot> embedded_;
  std::optional<HelixMotion> helix_;
  std::optional<TailMotion> tail_;
  double net_weight_;   // N
  double along_;        // N s/m: drag along the axis
  double across_;       // N s/m: drag across the axis
  double turning_;      // N m s: drag of turning across the axis
  double mean_radius_;  // m
};

}  // namespace vitreo::sim
