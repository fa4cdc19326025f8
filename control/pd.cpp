// SPDX-License-Identifier: Apache-2.0
#include "control/pd.h"

#include <cmath>
#include <stdexcept>

namespace vitreo::control {
namespace {

void require(bool good, const char* what) {
  if (!good) throw std::invalid_argument(what);
}

}  // namespace

void PdGains::check() const {
  require(std::isfinite(proportional) && proportional >= 0, "proportional: must be at least 0 1/s");
  require(std::isfinite(derivative) && derivative >= 0, "derivative: must be at least 0");
  require(std::isfinite(derivative_time) && derivative_time >= 0,
          "derivative_time: must be at least 0 s");
  require(std::isfinite(max_speed) && max_speed > 0, "max_speed: must be above 0 m/s");
  require(std::isfinite(integral) && integral >= 0, "integral: must be at least 0 1/s^2");
}

PdController::PdController(const PdGains& gains) : gains_(gains) { gains_.check(); }

Eigen::Vector3d PdController::update(double time, const Eigen::Vector3d& measured,
                                     const Reference& reference) {
  require(std::isfinite(time), "time: not finite");
  require(measured.allFinite(), "measured: not finite");
  require(reference.position.allFinite() && reference.velocity.allFinite(),
          "reference: not finite");
  require(!started_ || time >= time_, "time: runs backwards");
  const double since = started_ ? time - time_ : 0;
  if (!started_) {
    velocity_ = reference.velocity;  // nothing known yet: no derivative to act on
  } else if (time > time_) {
    const double step = time - time_;
    velocity_ +=
        step / (step + gains_.derivative_time) * ((measured - position_) / step - velocity_);
  }
  // A second measurement of the same moment says nothing of velocity and must not move the place it
  // is taken from.
  if (!started_ || time > time_) position_ = measured;
  started_ = true;
  time_ = time;
  const Eigen::Vector3d grown = sum_ + gains_.integral * since * (reference.position - measured);
  const Eigen::Vector3d other = reference.velocity +
                                gains_.proportional * (reference.position - measured) +
                                gains_.derivative * (reference.velocity - velocity_);
  Eigen::Vector3d asked = other + grown;
  if (asked.norm() <= gains_.max_speed || asked.norm() < (other + sum_).norm())
    sum_ = grown;
  else
    asked = other + sum_;  // at the limit nothing is wound up
  const double speed = asked.norm();
  return speed > gains_.max_speed ? Eigen::Vector3d(asked * (gains_.max_speed / speed)) : asked;
}

void PdController::reset() {
  started_ = false;
  sum_.setZero();
}

}  // namespace vitreo::control
