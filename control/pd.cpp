// SPDX-License-Identifier: Apache-2.0
#include "control/pd.h"

#include "control/preconditions.h"

#include <algorithm>
#include <cmath>

namespace vitreo::control {

void PdGains::check() const {
  require(not_negative(proportional), "proportional: must be at least 0 1/s");
  require(not_negative(derivative), "derivative: must be at least 0");
  require(not_negative(derivative_time), "derivative_time: must be at least 0 s");
  require(positive(max_speed), "max_speed: must be above 0 m/s");
  require(not_negative(integral), "integral: must be at least 0 1/s^2");
}

PdController::PdController(const PdGains& gains) : gains_(gains) { gains_.check(); }

// u = v_ref + Kp e + Ki integral(e) + Kd (v_ref - v), e = p_ref - p (thesis 6.2 with the integral
// of 7.3): the robot is overdamped, so the controller asks for a velocity, not for a force. v is
// the measured velocity behind a first-order low-pass of time constant T.
// m/s, at most max_speed and `at_most`. Times must not run backwards; `time` is that of the
// measurement, so that latency does not spoil the derivative.
Eigen::Vector3d PdController::update(double time, const Eigen::Vector3d& measured,
                                     const Reference& reference, double at_most) {
  require(std::isfinite(time), "time: not finite");
  require(measured.allFinite(), "measured: not finite");
  require(reference.position.allFinite() && reference.velocity.allFinite(),
          "reference: not finite");
  require(at_most > 0, "at_most: must be above 0 m/s");
  require(!started_ || time >= time_, "time: runs backwards");
  const double since = started_ ? time - time_ : 0;
  if (!started_) {
    velocity_ = reference.velocity;  // nothing known yet: no derivative to act on
  } else if (time > time_) {
    // The low-pass by backward Euler, v += h / (h + T) (dp / h - v): stable for any step h.
    const double step = time - time_;
    velocity_ +=
        step / (step + gains_.derivative_time) * ((measured - position_) / step - velocity_);
  }
  // A second measurement of the same moment says nothing of velocity and must not move the position
  // from which the next difference is taken.
  if (!started_ || time > time_) position_ = measured;
  started_ = true;
  time_ = time;
  // The sum is tried first and taken over below, as the limit decides about it.
  const Eigen::Vector3d sum = sum_ + gains_.integral * since * (reference.position - measured);
  const Eigen::Vector3d other = reference.velocity +
                                gains_.proportional * (reference.position - measured) +
                                gains_.derivative * (reference.velocity - velocity_);
  Eigen::Vector3d asked = other + sum;
  // Anti-windup by conditional integration: at the speed limit the sum is taken over only where it
  // leads out of the limit.
  const double limit = std::min(gains_.max_speed, at_most);
  if (asked.norm() <= limit || asked.norm() < (other + sum_).norm())
    sum_ = sum;
  else
    asked = other + sum_;
  const double speed = asked.norm();
  return speed > limit ? Eigen::Vector3d(asked * (limit / speed)) : asked;
}

// The gains stay. The next update has no derivative, as after the construction.
void PdController::reset() {
  started_ = false;
  sum_.setZero();
}

}  // namespace vitreo::control
