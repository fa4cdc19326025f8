// SPDX-License-Identifier: Apache-2.0
#include "control/swim_law.h"

#include "control/constants.h"
#include "control/preconditions.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>

namespace vitreo::control {
namespace {

// Slower than this a direction is of noise: the axis stays.
constexpr double kSlowest = 5e-6;  // m/s

// `from` turned towards `to`, both unit, by at most `most` rad.
Eigen::Vector3d turned(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double most) {
  const double angle = std::atan2(from.cross(to).norm(), from.dot(to));
  if (!(angle > most)) return to;
  // Straight back: any way round.
  if (!(from.cross(to).norm() > 1e-9))
    return (Eigen::AngleAxisd(most, from.unitOrthogonal()) * from).normalized();
  return (Eigen::AngleAxisd(most, from.cross(to).normalized()) * from).normalized();
}

// The head goes first: it cannot swim backwards, and turns round.
SwimCommand beat(const SwimSettings& settings, const Eigen::Vector3d& velocity,
                 const Eigen::Vector3d& before, double span) {
  SwimCommand command;
  command.axis = before.normalized();
  const double speed = velocity.norm();
  if (speed > kSlowest)
    command.axis = turned(command.axis, velocity / speed, settings.turn_rate * span);
  const double along = std::max(0.0, velocity.dot(command.axis));
  if (settings.speeds == nullptr || !(along > 0)) return command;
  const SpeedCurve& curve = *settings.speeds;
  const double most = std::min(settings.frequency, curve.fastest());
  const double reached = std::min(along, curve.speed(most));
  command.frequency = std::min(most, curve.frequency(reached));
  const double part = std::min(1.0, reached / curve.slowest_speed());
  command.swing = std::asin(std::sin(settings.swing) * std::sqrt(part));
  command.velocity = reached * command.axis;
  return command;
}

}  // namespace

void SwimSettings::check() const {
  require(std::isfinite(advance) && advance != 0, "advance: must not be 0 m/rad");
  require(positive(turn_rate), "turn_rate: must be above 0 rad/s");
  require(positive(frequency), "frequency: must be above 0 Hz");
  require(positive(swing) && swing < kPi / 2, "swing: must be within 0 and a right angle");
}

// In terms of the direction of motion d: the axis itself of a helix, a x n of a rolling robot,
// whose axis is a = n x d.
SwimCommand swim(const SwimSettings& settings, const Eigen::Vector3d& velocity,
                 const Eigen::Vector3d& normal, const Eigen::Vector3d& before, double span) {
  if (settings.mode == RotatingMode::oscillating) return beat(settings, velocity, before, span);
  const bool helix = settings.mode == RotatingMode::helix;
  const Eigen::Vector3d wanted =
      helix ? velocity : Eigen::Vector3d(velocity - velocity.dot(normal) * normal);
  Eigen::Vector3d direction = helix ? before : before.cross(normal);
  if (!(direction.norm() > 1e-3)) direction = normal.unitOrthogonal();  // the axis stood upright
  direction.normalize();
  const double speed = wanted.norm();
  if (speed > kSlowest) {
    // A helix goes backwards as well: the nearer end is turned, by a right angle at most, and the
    // frequency has the sign.
    const double sense = wanted.dot(direction) < 0 ? -1 : 1;
    direction = turned(direction, sense / speed * wanted, settings.turn_rate * span);
  }
  const double most = 2 * kPi * settings.frequency;
  // Along the axis that is reached alone: while it still turns, the cosine takes the speed back.
  const double rate = std::clamp(wanted.dot(direction) / settings.advance, -most, most);
  SwimCommand command;
  command.axis = helix ? direction : Eigen::Vector3d(normal.cross(direction).normalized());
  command.frequency = rate / (2 * kPi);
  command.velocity = settings.advance * rate * direction;
  return command;
}

}  // namespace vitreo::control
