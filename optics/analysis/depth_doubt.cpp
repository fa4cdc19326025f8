// SPDX-License-Identifier: Apache-2.0
#include "optics/analysis/depth_doubt.h"

#include "optics/numerics/preconditions.h"
#include "optics/system/first_order.h"

#include <algorithm>
#include <cmath>

namespace vitreo::optics {
namespace {

struct Viewpoint {
  double z;       // m, eye frame
  double length;  // m, front focal length
};

std::optional<Viewpoint> viewpoint_of(const System& system) {
  const auto points = cardinal_points(system);
  if (!points) return std::nullopt;
  return Viewpoint{system.vertex(2) + points->front_focus, points->front_focal_length};
}

}  // namespace

// Central differences of one sigma; a parameter whose eye is afocal, or unsound, to one side is
// taken to the other.
std::vector<ViewpointShift> viewpoint_shifts(const Prescription& prescription,
                                             const std::vector<Uncertainty>& uncertainties) {
  const auto middle = viewpoint_of(prescription.system);
  detail::require(middle.has_value(),
                  "prescription: is afocal, and shows nothing from a viewpoint");
  std::vector<ViewpointShift> shifts;
  for (const Uncertainty& one : applicable(uncertainties, prescription)) {
    const auto more = viewpoint_of(perturbed(prescription, one, 1).system);
    const auto less = viewpoint_of(perturbed(prescription, one, -1).system);
    const Viewpoint above = more.value_or(*middle);
    const Viewpoint below = less.value_or(*middle);
    const double sides = (more ? 1 : 0) + (less ? 1 : 0);
    detail::require(sides > 0, "prescription: is afocal beside its values");
    shifts.push_back(
        {(above.z - below.z) / sides, (above.length - below.length) / (sides * middle->length)});
  }
  return shifts;
}

void DepthDoubt::check() const {
  detail::require(std::isfinite(viewpoint), "depth doubt viewpoint: must be finite");
  detail::require(scale >= 0 && scale < 1, "depth doubt scale: must lie within 0 and 1");
  detail::require_not_negative(aside, "depth doubt aside");
  detail::require(residual >= 0 && residual < 1, "depth doubt residual: must lie within 0 and 1");
}

// From s f / (v - z') = (1 + ds) s (1 + df) f / (v + dv - z), to first order:
//   z' - z = (v - z) (ds + df) - dv,
// and with the scale calibrated at z0, where z' = z0: z' - z = -dv (z - z0) / (v - z0).
double DepthDoubt::sigma_z(double z) const {
  const double away = viewpoint - z;
  double variance = 0;
  if (calibrated_at) {
    const double lever = (z - *calibrated_at) / (viewpoint - *calibrated_at);
    variance += std::pow(away * residual, 2);
    for (const ViewpointShift& shift : eye) variance += std::pow(lever * shift.viewpoint, 2);
  } else {
    variance += std::pow(away * scale, 2);
    for (const ViewpointShift& shift : eye)
      variance += std::pow(away * shift.scale - shift.viewpoint, 2);
  }
  return std::sqrt(variance);
}

// What is off in depth is off along the line of sight; across it the place is the size's share.
Eigen::Matrix3d DepthDoubt::covariance(const Eigen::Vector3d& point_in_eye) const {
  constexpr double kNearest = 1e-4;  // m, before the viewpoint
  const double away = std::max(viewpoint - point_in_eye.z(), kNearest);
  const Eigen::Vector3d along(-point_in_eye.x() / away, -point_in_eye.y() / away, 1);
  const double sigma = sigma_z(point_in_eye.z());
  const double across = calibrated_at ? residual : scale;
  Eigen::Matrix3d covariance = sigma * sigma * along * along.transpose();
  covariance.topLeftCorner<2, 2>() +=
      across * across * point_in_eye.head<2>() * point_in_eye.head<2>().transpose() +
      aside * aside * Eigen::Matrix2d::Identity();
  return covariance;
}

}  // namespace vitreo::optics
