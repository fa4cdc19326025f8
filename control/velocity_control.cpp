// An integrator of the velocity's error, limited twice.
// SPDX-License-Identifier: Apache-2.0
#include "control/velocity_control.h"

#include <cmath>
#include <stdexcept>

namespace vitreo::control {
namespace {

void require(bool good, const char* what) {
  if (!good) throw std::invalid_argument(what);
}

Eigen::Vector3d shortened(const Eigen::Vector3d& v, double most) {
  const double length = v.norm();
  return length > most ? Eigen::Vector3d(v * (most / length)) : v;
}

}  // namespace

void VelocityGains::check() const {
  require(std::isfinite(proportional) && proportional > 0, "proportional: must be above 0 1/s");
  require(std::isfinite(max_speed) && max_speed > 0, "max_speed: must be above 0 m/s");
  require(std::isfinite(integral) && integral > 0, "integral: must be above 0 N/m");
  require(std::isfinite(velocity_time) && velocity_time >= 0,
          "velocity_time: must be at least 0 s");
  require(std::isfinite(max_force) && max_force > 0, "max_force: must be above 0 N");
}

VelocityController::VelocityController(const VelocityGains& gains) : gains_(gains) {
  gains_.check();
}

Eigen::Vector3d VelocityController::update(double time, const Eigen::Vector3d& measured,
                                           const Reference& reference) {
  require(std::isfinite(time), "time: not finite");
  require(measured.allFinite(), "measured: not finite");
  require(reference.position.allFinite() && reference.velocity.allFinite(),
          "reference: not finite");
  require(!started_ || time >= time_, "time: runs backwards");
  if (started_ && time > time_) {
    const double step = time - time_;
    velocity_ += step / (step + gains_.velocity_time) * ((measured - position_) / step - velocity_);
    const Eigen::Vector3d wanted =
        shortened(reference.velocity + gains_.proportional * (reference.position - measured),
                  gains_.max_speed);
    force_ = shortened(force_ + gains_.integral * step * (wanted - velocity_), gains_.max_force);
  }
  if (!started_ || time > time_) position_ = measured;
  started_ = true;
  time_ = time;
  return force_;
}

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
