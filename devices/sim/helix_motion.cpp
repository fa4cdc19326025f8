// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/helix_motion.h"

#include "devices/sim/checks.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>

namespace vitreo::sim {

HelixMotion::HelixMotion(const control::Helix& helix, double viscosity, double moment)
    : drag_(control::helix_resistance(helix, viscosity)), moment_(moment) {
  require_positive(moment, "the helix's moment");
}

// [F; T] = [a, b; b, c] [v; w] solved for w, (T - b F / a) / (c - b^2 / a), along the axis n and
// across it. rad/s.
Eigen::Vector3d HelixMotion::rate(const BodyState& body, const Eigen::Vector3d& field,
                                  const Eigen::Vector3d& force) const {
  const Eigen::Vector3d torque = moment(body).cross(field);
  const Eigen::Vector3d& n = body.axis;
  const Eigen::Vector3d across = torque - torque.dot(n) * n;
  const Eigen::Vector3d pushed = force - force.dot(n) * n;
  // advance = -b / a and free_spin = c - b^2 / a, the same across with their own coefficients: a
  // force that pulls a helix through the fluid turns it.
  const double spin = (torque.dot(n) + drag_.advance() * force.dot(n)) / drag_.free_spin();
  return spin * n + (across + drag_.advance_across() * pushed) / drag_.free_turning();
}

// The midpoint rule, in parts of the step in which the field's torque turns it by little: about the
// axis it is stiff, m B / c being hundreds a second.
HelixMotion::Step HelixMotion::turn(BodyState& body, const Eigen::Vector3d& field,
                                    const Eigen::Vector3d& force, double span) const {
  constexpr double kPart = 0.1;  // rad
  // rad/s, an upper bound: the whole torque m B over the smaller of the two drags.
  const double fastest =
      moment_ * field.norm() / std::min(drag_.free_spin(), drag_.free_turning()) + 1e-9;
  const int parts = std::max(1, static_cast<int>(std::ceil(fastest * span / kPart)));
  const double h = span / parts;
  Step step{Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
  for (int part = 0; part < parts; ++part) {
    BodyState middle = body;
    turn_body(middle, h / 2 * rate(body, field, force));
    const Eigen::Vector3d w = rate(middle, field, force);
    const Eigen::Vector3d spin = w.dot(middle.axis) * middle.axis;
    // What the force moves a body that does not turn is the caller's; here is what turning adds,
    // with the coupling across the axis, by which a helix that turns over goes aside.
    step.swum += h * (drag_.advance() * spin + drag_.advance_across() * (w - spin));
    step.turned += h * w;
    turn_body(body, h * w);
  }
  return step;
}

}  // namespace vitreo::sim
