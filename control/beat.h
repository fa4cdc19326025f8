// Beat: the to and fro of a swimmer in step with the field that drives it, learnt from a filter's
// innovations and taken off what is measured.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace vitreo::control {

/// Adaptive canceller of one frequency whose phase is known (Widrow et al. 1975, Proc. IEEE 63,
/// 1692): the swimmer's place is off its way by
///   s (a sin phi + b cos phi) e,
/// s the field's swing, phi its phase, e the direction in which it swings. a and b walk, and a
/// Kalman filter of the two finds them. A camera that is slower than the beat sees it at another
/// frequency, as a motion that a loop would answer; the phase tells them apart whatever the frames.
class Beat {
 public:
  /// What the field does at one moment.
  struct Moment {
    double phase = 0;                    // rad
    double swing = 0;                    // rad, to either side; 0: it stands
    Eigen::Vector3d direction{1, 0, 0};  // unit, world
  };
  /// m: by how much the place is off the way.
  Eigen::Vector3d displacement(const Moment& moment) const;
  /// `innovation`: m, what was measured, less displacement(), less what a filter predicted;
  /// `covariance`: m^2, of it. What is not finite is passed over.
  void learn(const Moment& moment, const Eigen::Vector3d& innovation,
             const Eigen::Matrix3d& covariance);
  /// m per rad of swing: of the sine and of the cosine.
  const Eigen::Vector2d& amplitudes() const { return amplitudes_; }
  void reset() { *this = Beat(); }

 private:
  static constexpr double kFirst = 0.2e-3;  // m/rad, standard deviation before anything is known
  Eigen::Vector2d amplitudes_{0, 0};
  Eigen::Matrix2d covariance_ = kFirst * kFirst * Eigen::Matrix2d::Identity();
};

}  // namespace vitreo::control
