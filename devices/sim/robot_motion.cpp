// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/robot_motion.h"

#include "control/robots.h"
#include "control/rolling.h"
#include "devices/sim/checks.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>

namespace vitreo::sim {
namespace {

constexpr double kBalance = 1e-4;       // rad, that an axis is tipped out of an unstable balance
constexpr double kWeakestField = 1e-6;  // T; below, nothing turns the robot

// Tips an axis out of unstable balance, where the torque vanishes and exact arithmetic would hold
// it for ever: against the field for a magnet, across it for a soft body, whose either end serves.
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

// The angle from the axis to its stable direction: the field's own sense for a magnet, either end
// for a soft body.
double angle_to(const Eigen::Vector3d& axis, const Eigen::Vector3d& field, bool either_end) {
  const double along = axis.dot(field);
  const double across = axis.cross(field).norm();
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
  require(!(robot.helix || robot.tail) || !gel,
          "a helix and a flexible tail are simulated in a fluid only, not in a gel");
  if (robot.tail)
    tail_.emplace(*robot.tail, around.dynamic_viscosity(), moment_gain * robot.moment(0));
  if (robot.helix)
    helix_.emplace(*robot.helix, around.dynamic_viscosity(), moment_gain * robot.moment(0));
  mean_radius_ = std::cbrt(robot.semi_axis * robot.semi_radius * robot.semi_radius);
}

void RobotMotion::relax() {
  if (embedded_) embedded_->relax();
  if (tail_) tail_->straighten();
}

// moment_gain is the error of the believed magnetization, volume and hysteresis
// (facts/magnetics 2.1, C).
// A m^2, in the world frame, from the body's axis and the field at it, T.
Eigen::Vector3d RobotMotion::moment(const BodyState& body, const Eigen::Vector3d& field) const {
  if (helix_) return helix_->moment(body);
  if (tail_) return tail_->moment(body);
  return moment_gain_ * control::robot_moment(robot_, body.axis, field);
}

// Mobility times force. Beside a wall the resistance is W R W (control::resistance_near_wall), so
// the mobility is W^-1 R^-1 W^-1; R, W and their inverses have the form a 1 + b n n', and no matrix
// is inverted. Retina and lens one after the other, as if each stood alone: an approximation
// between two walls.
Eigen::Vector3d RobotMotion::velocity(const BodyState& body, const Eigen::Vector3d& force,
                                      const Cavity* cavity) const {
  const auto free = [&](const Eigen::Vector3d& f) -> Eigen::Vector3d {
    return f / across_ + (1 / along_ - 1 / across_) * body.axis.dot(f) * body.axis;
  };
  if (cavity == nullptr) return free(force);
  // m: at the wall and behind it Faxen's factors stay as at a contact.
  constexpr double kNearest = 1e-9;
  const auto root = [&](const Eigen::Vector3d& normal, double distance) {
    const control::WallFactors factors = control::faxen(mean_radius_, std::max(distance, kNearest));
    const double along = 1 / std::sqrt(factors.along);
    const double extra = 1 / std::sqrt(factors.towards) - along;
    return [normal, along, extra](const Eigen::Vector3d& f) -> Eigen::Vector3d {
      return along * f + extra * normal.dot(f) * normal;
    };
  };
  const Cavity::Wall wall = cavity->retina(body.position);
  const auto retina = root(wall.normal, wall.distance);
  const auto lens = root(Eigen::Vector3d::UnitZ(), cavity->below_lens(body.position));
  return lens(retina(free(retina(lens(force)))));
}

// m: what the fluid between body and retina makes of its turning, for the sphere of its mean
// radius. Friction, where it touches, is the contact's (keep_inside).
Eigen::Vector3d RobotMotion::rolled(const BodyState& body, const Eigen::Vector3d& turned,
                                    const Cavity& cavity) const {
  const Cavity::Wall wall = cavity.retina(body.position);
  if (wall.distance > 3 * mean_radius_) return Eigen::Vector3d::Zero();
  const double part = control::fluid_rolling(mean_radius_, std::max(wall.distance, mean_radius_));
  return part * turned.cross(mean_radius_ * wall.normal);
}

// The walls slow what force and weight do; the swimmer's own advance stays as in the open.
RobotMotion::Step RobotMotion::swim(BodyState& body, const control::FieldGradient& field,
                                    const Eigen::Vector3d& extra_force, const Cavity* cavity,
                                    double span) {
  const Eigen::Vector3d before = body.position;
  // F = (m.grad) B.
  const Eigen::Vector3d force = extra_force - Eigen::Vector3d(0, 0, net_weight_) +
                                control::force_from_field(moment(body, field.head<3>())) * field;
  const Eigen::Vector3d drifting = velocity(body, force, cavity);
  Step turn;
  if (helix_) {
    const HelixMotion::Step screwed = helix_->turn(body, field.head<3>(), force, span);
    turn = {screwed.swum, screwed.turned};
  } else {
    const TailMotion::Step beaten = tail_->turn(body, field.head<3>(), force, span);
    turn = {beaten.swum, beaten.turned};
  }
  body.position += span * drifting + turn.moved;
  return {body.position - before, turn.turned};
}

// One step of m x B = z w and F = R v (overdamped). The torque falls to zero at the angle th to the
// stable direction; taken as proportional to it, k = |T| / th, the turn is th (1 - e^(-k h / z)),
// exact for any step and never beyond. Position by Euler's rule: it changes on the scale of seconds
// (facts/magnetics 2.1).
RobotMotion::Step RobotMotion::step(BodyState& body, const control::FieldGradient& field,
                                    const Eigen::Vector3d& extra_force, const Cavity* cavity,
                                    double span) {
  if (helix_ || tail_) return swim(body, field, extra_force, cavity, span);
  const Eigen::Vector3d b = field.head<3>();
  const bool felt = b.norm() > kWeakestField;
  Eigen::Vector3d torque = Eigen::Vector3d::Zero();
  Eigen::Vector3d turned = Eigen::Vector3d::Zero();
  double stiffness = 0;  // N m/rad: the torque over the angle that is left
  if (felt) {
    unbalance(body.axis, b, !robot_.hard);
    torque = moment(body, b).cross(b);
    const double angle = angle_to(body.axis, b, !robot_.hard);
    if (angle > 1e-12) stiffness = torque.norm() / angle;
    if (!embedded_ && stiffness > 0)
      turned = torque / stiffness * -std::expm1(-stiffness * span / turning_);
  }
  // In a fluid the robot turns first, and the force is that on the turned moment. In a gel force
  // and torque share one yield surface, so one implicit step takes both, from the moment at the
  // step's start.
  const Eigen::Vector3d before = body.position;
  Eigen::Vector3d force = extra_force - Eigen::Vector3d(0, 0, net_weight_);
  if (!embedded_) turn_body(body, turned);
  // F = (m.grad) B.
  if (felt) force += control::force_from_field(moment(body, b)) * field;
  if (embedded_) {
    const control::EmbeddedRobot::Rates rates =
        embedded_->step(body.axis, force, torque, stiffness, span);
    turned = span * rates.turning;
    turn_body(body, turned);
    body.position += span * rates.velocity;
  } else {
    body.position += span * velocity(body, force, cavity);
    if (cavity != nullptr) body.position += rolled(body, turned, *cavity);
  }
  return {body.position - before, turned};
}

}  // namespace vitreo::sim
