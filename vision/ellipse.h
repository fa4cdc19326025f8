// An ellipse in an image, as a tracker reports it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace vitreo::vision {

/// First pixel's centre at (0, 0), u right, v down.
struct Ellipse {
  Eigen::Vector2d centre_px{0, 0};
  double semi_major_px = 0, semi_minor_px = 0;
  double angle = 0;  ///< rad, of the major axis, from +u towards +v, in (-pi/2, pi/2]
  /// (u, v, semi-major, semi-minor, angle), in the units above.
  Eigen::Matrix<double, 5, 1> vector() const;
};

struct EllipseMeasurement {
  Ellipse ellipse;
  Eigen::Matrix<double, 5, 5> covariance = Eigen::Matrix<double, 5, 5>::Zero();  ///< of Ellipse::vector()
  double inlier_fraction = 0;   ///< of the contour points that were used
  double contrast = 0;          ///< grey levels between ground and object, median over the contour
};

}  // namespace vitreo::vision
