// Position controller of the thesis (6.2): PD with the reference's velocity fed forward, and the
// PID of 7.3.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <limits>

namespace vitreo::control {

struct PdGains {
  double proportional = 1.5;     // 1/s
  double derivative = 0.05;      // dimensionless: velocity asked per velocity error
  double derivative_time = 0.2;  // s, of the low-pass on the measured velocity
  double max_speed = 2e-3;       // m/s, of the velocity asked for
  // 1/s^2: velocity asked per position error and time; held while the speed is limited
  double integral = 0;
  void check() const;  // throws std::invalid_argument naming the gain
};

struct Reference {
  Eigen::Vector3d position{0, 0, 0};  // m, world
  Eigen::Vector3d velocity{0, 0, 0};  // m/s
};

/// Measurements may come irregularly; time must not run backwards, nothing may be NaN
/// (std::invalid_argument). The derivative joins at the second measurement: the first says nothing
/// about velocity.
class PdController {
 public:
  explicit PdController(const PdGains& gains);
  /// The velocity to ask for, m/s, world. `time` in s, positions in m. `at_most`: m/s, a limit of
  /// this moment, where it is below the gains' own.
  Eigen::Vector3d update(double time, const Eigen::Vector3d& measured, const Reference& reference,
                         double at_most = std::numeric_limits<double>::infinity());
  void reset();

 private:
  PdGains gains_;
  bool started_ = false;
  double time_ = 0;
  Eigen::Vector3d position_{0, 0, 0};
  Eigen::Vector3d velocity_{0, 0, 0};
  Eigen::Vector3d sum_{0, 0, 0};  // m/s: what the integral asks for
};

}  // namespace vitreo::control
