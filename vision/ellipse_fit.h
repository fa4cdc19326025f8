// Robust geometric ellipse fit: correction of an ellipse from distances measured along its normals.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/ellipse.h"

#include <Eigen/Core>

#include <vector>

namespace vitreo::vision {

/// One contour point: the rim's normal there and what was found along it.
struct Normal {
  Eigen::Vector2d circle{1, 0};   // on the unit circle that the ellipse's shape maps to the rim
  Eigen::Vector2d rim_px{0, 0};   // the ellipse's point
  Eigen::Vector2d outward{1, 0};  // unit
  bool found = false;
  double shift_px = 0;     // of the true rim along `outward`
  double variance = 0;     // px^2, of shift_px
  double contrast = 0;     // gray levels, object less ground
  double softness_px = 0;  // of the step there: over how long a way evidence tells no side
  double weight = 0;       // 0 to 1: consistency with the others (IRLS); set by the fit
};

/// As many as `normals` has, at equal steps of the ellipse's parameter from its major axis; all of
/// them begin anew.
void place_normals(const Ellipse& ellipse, std::vector<Normal>& normals);

struct FittedEllipse {
  Ellipse ellipse;
  Eigen::Matrix<double, 5, 5> covariance;  ///< as EllipseMeasurement
  bool valid = false;
};

/// Gaussian prior of the ellipse; an infinite deviation carries no information.
struct EllipsePrior {
  Ellipse ellipse;
  /// Standard deviations; the angle's acts in proportion to the difference of the axes.
  double center_px = 0;
  double semi_axes_px = 0;
  double angle = 0;
};

/// Geometric fit: iteratively re-weighted least squares (Cauchy, then Tukey) of the distances along
/// the normals, linearized around `start` in center and shape matrix; sets the normals' weights.
/// Not an algebraic fit of a conic (Halir & Flusser 1998, Fitzgibbon et al. 1999): the residuals
/// are distances in px, each with its own variance. Not valid when fewer than 35 % of the normals,
/// or than 8, agree (by the scatter found, not by their variances) or the result is no ellipse.
/// Without `prior` the normals alone count. At most 1024 normals. `correlation_length`: number of
/// neighboring normals with a common error, as integrated_autocorrelation() estimates it; the
/// normals' information is divided by it, so the prior counts for more and the covariance grows.
FittedEllipse fit_ellipse(const Ellipse& start, std::vector<Normal>& normals,
                          const EllipsePrior* prior = nullptr, double correlation_length = 1);

/// The same of a body with corners, whose rim lies off any ellipse by pixels: plain least squares
/// in which all found normals count alike, the ellipse of the same definition as a model's
/// (optics/pose/body_outline.h). The covariance is that of the normals' own variances. Not valid
/// when fewer than half of the normals are found.
FittedEllipse fit_cornered(const Ellipse& start, std::vector<Normal>& normals);

/// Integrated autocorrelation 1 + 2 sum_k rho_k of the residuals `shift_px` around the rim (cyclic,
/// at equal steps, weighted), cut at the first rho_k that is not positive (cf. Geyer 1992) or after
/// a sixth of the rim: 1 for independent normals, more where a vessel, a shadow or smoothing moves
/// neighbors together.
double integrated_autocorrelation(const std::vector<Normal>& normals);

}  // namespace vitreo::vision
