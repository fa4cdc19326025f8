// Moves an ellipse to where distances along its normals say, however many of them are wrong.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/ellipse.h"

#include <Eigen/Core>

#include <vector>

namespace vitreo::vision {

/// One contour point looked for: the rim's normal there and what was found along it.
struct Normal {
  Eigen::Vector2d circle{1, 0};   // on the unit circle that the ellipse's shape maps to the rim
  Eigen::Vector2d rim_px{0, 0};   // the ellipse's point
  Eigen::Vector2d outward{1, 0};  // unit
  bool found = false;
  double shift_px = 0;  // of the true rim along `outward`
  double variance = 0;  // px^2, of shift_px
  double contrast = 0;  // gray levels, object less ground
  double weight = 0;    // 0 to 1: how far it is in line with the others; set by the fit
};

/// `count` normals at equal steps of the ellipse's parameter from its major axis.
void place_normals(const Ellipse& ellipse, std::vector<Normal>& normals);

struct FittedEllipse {
  Ellipse ellipse;
  Eigen::Matrix<double, 5, 5> covariance;  ///< as EllipseMeasurement
  bool valid = false;
};

/// What is known of the ellipse before its normals are looked at; an infinite deviation says
/// nothing.
struct EllipsePrior {
  Ellipse ellipse;
  double center_px = 0, semi_axes_px = 0,
         angle = 0;  ///< standard deviations; the angle's counts as the axes differ
};

/// Iteratively re-weighted least squares (Tukey) on the normals' distances, around `start`; sets
/// the normals' weights. Not valid when fewer than a third of the normals agree or the result is no
/// ellipse. Without `prior` they alone count. At most 1024 normals. `together`: how many
/// neighboring normals err as one, as error_correlation() says; the prior then counts for more and
/// the covariance grows as much.
FittedEllipse fit_ellipse(const Ellipse& start, std::vector<Normal>& normals,
                          const EllipsePrior* prior = nullptr, double together = 1);

/// 1 for normals that scatter each on its own; more where a vessel, a shadow or smoothing moves
/// neighbors together: the sum of the autocorrelation of what `shift_px` leaves around the rim, of
/// normals that agree (cyclic, at equal steps).
double error_correlation(const std::vector<Normal>& normals);

}  // namespace vitreo::vision
