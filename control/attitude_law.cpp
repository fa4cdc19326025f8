// SPDX-License-Identifier: Apache-2.0
#include "control/attitude_law.h"

#include "control/preconditions.h"

#include <Eigen/Geometry>

#include <cmath>

namespace vitreo::control {

void AttitudeGains::check() const {
  require(not_negative(integral), "attitude integral: must be at least 0 1/s");
  require(not_negative(most) && most < 1, "attitude most: must be within 0 and 1 rad");
  require(positive(sigma), "attitude sigma: must be above 0 rad");
}

AttitudeLaw::AttitudeLaw(const AttitudeGains& gains) : gains_(gains) { gains_.check(); }

// The weight of a measurement is sigma^2 / (sigma^2 + its own variance).
void AttitudeLaw::update(const Eigen::Vector3d& measured, double sigma,
                         const Eigen::Vector3d& wanted, double span) {
  if (!measured.allFinite() || !std::isfinite(sigma) || !(span > 0)) return;
  const bool turned_round = gains_.either_end && measured.dot(wanted) < 0;
  const Eigen::Vector3d axis = turned_round ? Eigen::Vector3d(-measured) : measured;
  const double weight = gains_.sigma * gains_.sigma / (gains_.sigma * gains_.sigma + sigma * sigma);
  correction_ += gains_.integral * span * weight * axis.cross(wanted);
  const double length = correction_.norm();
  if (length > gains_.most) correction_ *= gains_.most / length;
}

Eigen::Vector3d AttitudeLaw::field_direction(const Eigen::Vector3d& wanted) const {
  const double angle = correction_.norm();
  if (!(angle > 1e-12)) return wanted;
  return (Eigen::AngleAxisd(angle, correction_ / angle) * wanted).normalized();
}

}  // namespace vitreo::control
