// Attitude law: the field's direction for a wanted axis of the robot, with what the measured axis
// shows the field to be off.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace vitreo::control {

struct AttitudeGains {
  double integral = 1.2;    // 1/s: rate of the correction per error
  double most = 0.26;       // rad, of the correction: 15 degrees
  double sigma = 0.035;     // rad: a measured axis that is less certain counts less
  bool either_end = false;  // of a soft robot: its axis has no sense
  void check() const;       // throws std::invalid_argument naming the gain
};

/// The axis follows the field within milliseconds, so the axis measured is the field that was
/// commanded a delay ago, turned by the coils' errors: an integral of the error, as a rotation
/// vector r on the wanted axis, makes them good. r' = k (measured x wanted), for small angles the
/// angle between. Stable for k below pi / 2 over the delay.
class AttitudeLaw {
 public:
  explicit AttitudeLaw(const AttitudeGains& gains);
  /// `measured` (unit) and `wanted` (unit) of one moment; `sigma`: of the measured, rad; `span`: s
  /// since the last one.
  void update(const Eigen::Vector3d& measured, double sigma, const Eigen::Vector3d& wanted,
              double span);
  /// Unit: where the field has to point for `wanted`.
  Eigen::Vector3d field_direction(const Eigen::Vector3d& wanted) const;
  const Eigen::Vector3d& correction() const { return correction_; }  // rad
  void reset() { correction_.setZero(); }

 private:
  AttitudeGains gains_;
  Eigen::Vector3d correction_{0, 0, 0};
};

}  // namespace vitreo::control
