// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/robot_motion.h"

#include "control/robots.h"
#include "devices/sim/checks.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>

namespace vitreo::sim {
namespace {

constexpr double kBalance = 1e-4;       // rad
constexpr double kWeakestField = 1e-6;  // T; below, nothing turns the robot

/// Tips an axis that balances where the field would push it either way.
void unbalance(Eigen::Vector3d& axis, const Eigen::Vector3d& field, bool either_end) {
  const Eigen::Vector3d along = field.normalized();
  const double part = axis.dot(along);
  if (either_end) {
    if (std::abs(part) < kBalance) axis = (axis + kBalance * along).normalized();
  } else if (part < 0 && axis.cross(along).norm() < kBalance) {
    const Eigen::Vector3d other =
        std::abs(along.y()) < 0.9 ? Eigen::Vector3d::UnitY() : Eigen::Vector3d::UnitZ();
    axis = (axis + kBalance * along.cross(other).normalized()).normalized();
  }
}

/// The angle from the axis to where the field wants it: its own sense for a magnet, either end for
/// a soft body.
double angle_to(const Eigen::Vector3d& axis, const Eigen::Vector3d& field, bool either_end) {
  const double along = axis.dot(field), across = axis.cross(field).norm();
  return std::atan2(across, either_end ? std::abs(along) : along);
}

}  // namespace

RobotMotion::RobotMotion(const control::Robot& robot, const control::Medium& fluid,
                         const std::optional<control::Gel>& gel, double moment_gain)
    : robot_(robot), moment_gain_(moment_gain) {
  robot.check();
  fluid.check();
  require_positive(moment_gain, "moment_gain");
  control::Medium around = fluid;
  if (gel) {
    embedded_.emplace(robot, *gel);
    around = {gel->name, gel->density, gel->solvent_viscosity / gel->density};
  }
  net_weight_ = robot.net_weight(around);
  const Eigen::Matrix3d free = control::resistance(robot, around, Eigen::Vector3d::UnitX());
  along_ = free(0, 0);
  across_ = free(1, 1);
  turning_ = control::rotational_resistance(robot, around);
  mean_radius_ = std::cbrt(robot.semi_axis * robot.semi_radius * robot.semi_radius);
}

void RobotMotion::relax() {
  if (embedded_) embedded_->relax();
}

Eigen::Vector3d RobotMotion::moment(const BodyState& body, const Eigen::Vector3d& field) const {
  return moment_gain_ * control::robot_moment(robot_, body.axis, field);
}

/// Mobility times force. The wall's resistance is W R W (control::resistance_near_wall), so its
/// mobility is W^-1 R^-1 W^-1, all of them a multiple of one and of a direction with itself.
Eigen::Vector3d RobotMotion::velocity(const BodyState& body, const Eigen::Vector3d& force,
                                      const Cavity* cavity) const {
  const auto free = [&](const Eigen::Vector3d& f) -> Eigen::Vector3d {
    return f / across_ + (1 / along_ - 1 / across_) * body.axis.dot(f) * body.axis;
  };
  if (cavity == nullptr) return free(force);
  constexpr double kNearest =
      1e-9;  // m: at the wall itself Faxen's factors stay as they are at a contact
  const auto root = [&](const Eigen::Vector3d& normal, double distance) {
    const control::WallFactors factors = control::faxen(mean_radius_, std::max(distance, kNearest));
    const double along = 1 / std::sqrt(factors.along),
                 extra = 1 / std::sqrt(factors.towards) - along;
    return [normal, along, extra](const Eigen::Vector3d& f) -> Eigen::Vector3d {
      return along * f + extra * normal.dot(f) * normal;
    };
  };
  const Cavity::Wall wall = cavity->retina(body.position);
  const auto retina = root(wall.normal, wall.distance);
  const auto lens = root(Eigen::Vector3d::UnitZ(), cavity->below_lens(body.position));
  return lens(retina(free(retina(lens(force)))));
}

RobotMotion::Step RobotMotion::step(BodyState& body, const control::FieldGradient& field,
                                    const Eigen::Vector3d& push, const Cavity* cavity,
                                    double span) {
  const Eigen::Vector3d b = field.head<3>();
  const bool felt = b.norm() > kWeakestField;
  Eigen::Vector3d torque = Eigen::Vector3d::Zero(), turned = Eigen::Vector3d::Zero();
  double stiffness = 0;  // N m/rad: the torque over the angle that is left
  if (felt) {
    unbalance(body.axis, b, !robot_.hard);
    torque = moment(body, b).cross(b);
    const double angle = angle_to(body.axis, b, !robot_.hard);
    if (angle > 1e-12) stiffness = torque.norm() / angle;
    if (!embedded_ && stiffness > 0)
      turned = torque / stiffness * -std::expm1(-stiffness * span / turning_);
  }
  // The force is that on the moment as it lies at the step's start; in a gel, force and torque
  // yield it together.
  const Eigen::Vector3d before = body.position;
  Eigen::Vector3d force = push - Eigen::Vector3d(0, 0, net_weight_);
  if (!embedded_) turn_body(body, turned);
  if (felt) force += control::force_from_field(moment(body, b)) * field;
  if (embedded_) {
    const control::EmbeddedRobot::Rates rates =
        embedded_->step(body.axis, force, torque, stiffness, span);
    turned = span * rates.turning;
    turn_body(body, turned);
    body.position += span * rates.velocity;
  } else {
    body.position += span * velocity(body, force, cavity);
  }
  return {body.position - before, turned};
}

}  // namespace vitreo::sim
