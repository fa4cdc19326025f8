// SPDX-License-Identifier: Apache-2.0
#include "control/velocity_control.h"

#include "control/preconditions.h"

#include <cmath>

namespace vitreo::control {
namespace {

// v, or the vector of its direction with the length `most`.
Eigen::Vector3d shortened(const Eigen::Vector3d& v, double most) {
  const double length = v.norm();
  return length > most ? Eigen::Vector3d(v * (most / length)) : v;
}

}  // namespace

void VelocityGains::check() const {
  require(positive(proportional), "proportional: must be above 0 1/s");
  require(positive(max_speed), "max_speed: must be above 0 m/s");
  require(positive(integral), "integral: must be above 0 N/m");
  require(not_negative(velocity_time), "velocity_time: must be at least 0 s");
  require(positive(max_force), "max_force: must be above 0 N");
}

VelocityController::VelocityController(const VelocityGains& gains) : gains_(gains) {
  gains_.check();
}

// f' = K (v_wanted - v) by Euler's rule, a velocity controller as the thesis' 7.3 suggests in place
// of its PID: the force needs no model of the medium, because its integral finds what yields it.
// The limit on |f| is the anti-windup: nothing is summed up beyond it.
// N, at most max_force. The force is kept from one call to the next: it is the controller's whole
// memory of the medium.
Eigen::Vector3d VelocityController::update(double time, const Eigen::Vector3d& measured,
                                           const Reference& reference) {
  require(std::isfinite(time), "time: not finite");
  require(measured.allFinite(), "measured: not finite");
  require(reference.position.allFinite() && reference.velocity.allFinite(),
          "reference: not finite");
  require(!started_ || time >= time_, "time: runs backwards");
  if (started_ && time > time_) {
    const double step = time - time_;
    // Low-pass of the measured velocity by backward Euler, as in PdController.
    velocity_ += step / (step + gains_.velocity_time) * ((measured - position_) / step - velocity_);
    const Eigen::Vector3d wanted =
        shortened(reference.velocity + gains_.proportional * (reference.position - measured),
                  gains_.max_speed);
    force_ = shortened(force_ + gains_.integral * step * (wanted - velocity_), gains_.max_force);
  }
  // As in PdController: a second measurement of one moment is not a new start of the difference.
  if (!started_ || time > time_) position_ = measured;
  started_ = true;
  time_ = time;
  return force_;
}

// What the allocation left of the force: the integral goes on from there, and so winds nothing up.
void VelocityController::limited_to(const Eigen::Vector3d& force) {
  require(force.allFinite(), "force: not finite");
  force_ = force;
}

void VelocityController::reset() {
  started_ = false;
  velocity_.setZero();
  force_.setZero();
}

}  // namespace vitreo::control
