// SPDX-License-Identifier: Apache-2.0
#include "control/beat.h"

#include <algorithm>
#include <cmath>

namespace vitreo::control {
namespace {

// m: of an innovation, beside its covariance: what a second harmonic and an axis that turns leave.
constexpr double kLeft = 60e-6;
// m/rad from one measurement to the next: a swimmer's amplitude changes by a tenth as it turns
// round on its path, within some tens of frames.
constexpr double kWalk = 0.5e-6;

Eigen::Vector2d regressors(const Beat::Moment& moment) {
  return moment.swing * Eigen::Vector2d(std::sin(moment.phase), std::cos(moment.phase));
}

}  // namespace

Eigen::Vector3d Beat::displacement(const Moment& moment) const {
  return regressors(moment).dot(amplitudes_) * moment.direction;
}

// Where frames come at a whole number of half beats one of both is not seen: it is no more unknown
// than at first.
void Beat::learn(const Moment& moment, const Eigen::Vector3d& innovation,
                 const Eigen::Matrix3d& covariance) {
  const double along = innovation.dot(moment.direction);
  const double noise = moment.direction.dot(covariance * moment.direction) + kLeft * kLeft;
  const Eigen::Vector2d h = regressors(moment);
  if (!std::isfinite(along) || !std::isfinite(noise) || !h.allFinite() || h.isZero(0)) return;
  covariance_ += kWalk * kWalk * Eigen::Matrix2d::Identity();
  const Eigen::Vector2d gain = covariance_ * h / (h.dot(covariance_ * h) + noise);
  amplitudes_ += gain * along;
  // Joseph form: stays positive definite.
  const Eigen::Matrix2d left = Eigen::Matrix2d::Identity() - gain * h.transpose();
  covariance_ = left * covariance_ * left.transpose() + noise * gain * gain.transpose();
  const double largest = covariance_.diagonal().maxCoeff();
  if (largest > kFirst * kFirst) covariance_ *= kFirst * kFirst / largest;
}

}  // namespace vitreo::control
