// Ellipse in an image, and its measurement with covariance as a tracker reports it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <vector>

namespace vitreo::vision {

/// First pixel's center at (0, 0), u right, v down.
struct Ellipse {
  Eigen::Vector2d center_px{0, 0};
  double semi_major_px = 0;
  double semi_minor_px = 0;
  double angle = 0;  ///< rad, of the major axis, from +u towards +v, in (-pi/2, pi/2]
  /// (u, v, semi-major, semi-minor, angle), in the units above.
  Eigen::Matrix<double, 5, 1> vector() const;
  /// On the rim; t from the major axis, the parameter of (a cos t, b sin t).
  Eigen::Vector2d point(double t) const;
  /// Symmetric S with rim = center + S (unit circle), px; eigenvalues are the semi-axes. Unlike
  /// axes and angle it is smooth where the axes are equal.
  Eigen::Matrix2d shape() const;
  static Ellipse from_shape(const Eigen::Vector2d& center_px, const Eigen::Matrix2d& shape);
};

/// A point of the rim in the image, wherever the ellipse runs.
struct ContourPoint {
  Eigen::Vector2d point_px{0, 0};
  Eigen::Vector2d outward{1, 0};  ///< unit: the normal along which it was found
  double variance = 0;            ///< px^2, along it
};

struct EllipseMeasurement {
  Ellipse ellipse;
  /// Of Ellipse::vector(); for a circle the angle's is that of a uniform distribution over pi.
  Eigen::Matrix<double, 5, 5> covariance = Eigen::Matrix<double, 5, 5>::Zero();
  /// Of all contour points searched: those found and consistent with the ellipse.
  double inlier_fraction = 0;
  double contrast = 0;  ///< gray levels between ground and object, median over the contour
  /// In order round the rim, also those that do not agree with the ellipse; a tracker that measures
  /// no contour leaves it empty.
  std::vector<ContourPoint> contour{};
};

}  // namespace vitreo::vision
