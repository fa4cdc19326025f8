// SPDX-License-Identifier: Apache-2.0
#include "optics/pose/body_pose.h"

#include "optics/numerics/preconditions.h"

#include <Eigen/Geometry>

#include <stdexcept>

namespace vitreo::optics {

/// Infinite sigmas are allowed: they mean "not known".
/// The single viewpoint is checked only where it is used, as the exact projection replaces it.
void ObjectPoseSettings::check() const {
  if (!exact) projection.check();
  image.check();
  object.check();
  detail::require(orientation_sigma > 0, "orientation_sigma: must be positive");
  detail::require(!roll_sigma || *roll_sigma > 0, "roll_sigma: must be positive");
  detail::require(scale_sigma >= 0, "scale_sigma: must not be negative");
  if (contour_points < 12 || contour_points > 256) {
    throw std::invalid_argument("contour_points: must lie between 12 and 256");
  }
  detail::require(max_residual_px > 0, "max_residual_px: must be positive");
  detail::require_not_negative(behind_retina, "behind_retina");
  detail::require(equal_chi2 >= 0, "equal_chi2: must not be negative");
}

const char* to_string(PoseStatus status) {
  switch (status) {
    case PoseStatus::found:
      return "found";
    case PoseStatus::ambiguous:
      return "ambiguous";
    case PoseStatus::misfit:
      return "misfit";
    case PoseStatus::not_converged:
      return "not_converged";
    case PoseStatus::outside:
      return "outside";
  }
  return "outside";
}

/// The shortest such rotation, about z x axis.
Eigen::Matrix3d orientation_along(const Eigen::Vector3d& axis_in_eye) {
  detail::require(axis_in_eye.allFinite() && axis_in_eye.norm() > 0,
                  "axis_in_eye: must be finite and not zero");
  return Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), axis_in_eye)
      .toRotationMatrix();
}

}  // namespace vitreo::optics
