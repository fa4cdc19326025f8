// Velocity controller for media that yield and spring back (thesis 7.3).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/pd.h"

#include <Eigen/Core>

namespace vitreo::control {

/// The defaults suit a 1 mm NdFeB cylinder at 15 frames/s and 130 ms latency, in gels from 2.8 Pa
/// on and in oil of 500 cSt. In a gel of modulus G' an `integral` of up to 0.4 * 6 pi G' r is as
/// safe, and faster (r: of the ball with the robot's drag).
struct VelocityGains {
  double proportional = 0.3;    // 1/s: velocity wanted per position error
  double max_speed = 0.2e-3;    // m/s wanted at most: what makes the approach slow enough to stop
  double integral = 0.01;       // N/m: force per unit of distance that the robot has stayed behind
  double velocity_time = 0.13;  // s, of the low-pass on the measured velocity
  double max_force = 200e-6;    // N
  void check() const;           // throws std::invalid_argument naming the gain
};

/// f' = integral (v_wanted - v), v_wanted = v_ref + Kp (p_ref - p) limited in length: the force
/// rises until the medium yields, whatever that takes, and falls as the robot nears its goal, so
/// that nothing is left wound up to overshoot with. The force is limited by length and holds there
/// (anti-windup). Time as in PdController.
class VelocityController {
 public:
  explicit VelocityController(const VelocityGains& gains);
  /// The force to make besides levitation, N.
  Eigen::Vector3d update(double time, const Eigen::Vector3d& measured, const Reference& reference);
  /// The force that the allocation could make of the last one, N: the next begins from there.
  void limited_to(const Eigen::Vector3d& force);
  void reset();

 private:
  VelocityGains gains_;
  bool started_ = false;
  double time_ = 0;
  Eigen::Vector3d position_{0, 0, 0};
  Eigen::Vector3d velocity_{0, 0, 0};
  Eigen::Vector3d force_{0, 0, 0};
};

}  // namespace vitreo::control
