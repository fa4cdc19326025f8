// Weighting of an ellipse by its tracker's covariance, direction by direction, also where the
// ellipse is nearly a circle.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace vitreo::optics::detail {

/// Turns the difference of two ellipses in smooth coordinates (center, (a+b)/2, (a-b)/2 times
/// cosine and sine of twice the angle; px) into independent terms of unit variance: terms = root *
/// (shown - observed).
struct EllipseWeight {
  Eigen::Matrix<double, 5, 5> root;
  int terms = 5;  // 3, the last rows zero, when the angle is not known
};

/// `observed`: center, semi-axes (px), angle (rad); `covariance` of these. With d = (a - b) / 2 the
/// angle counts as a distance, 2 d times its error. Where the axes differ by less than three sigma
/// of d there is no direction in which the ellipse is long, so both count with d's variance and the
/// angle's own is not used. Where they do differ and the angle's sigma is still above 0.25 rad, a
/// direction was not measured: the mean of the axes and the center remain. Throws
/// std::invalid_argument naming `covariance` when it is not finite, symmetric and positive
/// definite.
EllipseWeight ellipse_weight(const Eigen::Matrix<double, 5, 1>& observed,
                             const Eigen::Matrix<double, 5, 5>& covariance);

}  // namespace vitreo::optics::detail
