// SPDX-License-Identifier: Apache-2.0
#include "optics/pose/pose_settings.h"

#include "optics/numerics/preconditions.h"

#include <stdexcept>

namespace vitreo::optics {

/// The single viewpoint is not checked when the exact projection replaces it.
void PoseSettings::check() const {
  if (!exact) projection.check();
  image.check();
  detail::require_positive(robot.semi_axis, "semi_axis");
  detail::require_positive(robot.semi_radius, "semi_radius");
  detail::require_not_negative(angle_weight, "angle_weight");
  if (contour_points < 8 || contour_points > detail::kMaxContourPoints) {
    throw std::invalid_argument("contour_points: must lie between 8 and 64");
  }
  detail::require(max_residual_px > 0, "max_residual_px: must be positive");
  detail::require_not_negative(behind_retina, "behind_retina");
}

/// Axes in order, since angle and axes exchange otherwise: throws std::invalid_argument naming
/// `observed`.
void detail::check_ellipse(const EllipseVector& observed) {
  detail::require(observed.allFinite(), "observed: must be finite");
  detail::require(observed[3] > 0 && observed[2] >= observed[3],
                  "observed: needs semi-major >= semi-minor > 0");
}

}  // namespace vitreo::optics
