// SPDX-License-Identifier: Apache-2.0
#include "vision/ellipse.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace vitreo::vision {

// (u, v, a, b, angle): the order of every covariance of an ellipse.
Eigen::Matrix<double, 5, 1> Ellipse::vector() const {
  Eigen::Matrix<double, 5, 1> v;
  v << center_px, semi_major_px, semi_minor_px, angle;
  return v;
}

// In image coordinates, v down, so t runs from +u towards +v.
Eigen::Vector2d Ellipse::point(double t) const {
  const double x = semi_major_px * std::cos(t);
  const double y = semi_minor_px * std::sin(t);
  return center_px + Eigen::Vector2d(x * std::cos(angle) - y * std::sin(angle),
                                     x * std::sin(angle) + y * std::cos(angle));
}

// S = a e e' + b f f' with the unit vectors e, f of the axes.
// The symmetric root of the ellipse's matrix: the rim is c + S q with |q| = 1. Smooth where the
// axes are equal, as axes and angle are not.
Eigen::Matrix2d Ellipse::shape() const {
  const Eigen::Vector2d e(std::cos(angle), std::sin(angle));
  const Eigen::Vector2d f(-e.y(), e.x());
  return semi_major_px * e * e.transpose() + semi_minor_px * f * f.transpose();
}

// Eigenvalues and major direction of a symmetric 2 x 2 matrix in closed form.
// The angle of a circle is 0 by convention.
Ellipse Ellipse::from_shape(const Eigen::Vector2d& center_px, const Eigen::Matrix2d& shape) {
  const double mean = (shape(0, 0) + shape(1, 1)) / 2;
  const double half = (shape(0, 0) - shape(1, 1)) / 2;
  const double off = shape(0, 1);
  const double spread = std::hypot(half, off);
  double angle = spread > 0 ? std::atan2(off, half) / 2 : 0;  // in [-pi/2, pi/2]
  if (angle <= -std::numbers::pi / 2) angle = std::numbers::pi / 2;
  return {center_px, mean + spread, mean - spread, angle};
}

}  // namespace vitreo::vision
