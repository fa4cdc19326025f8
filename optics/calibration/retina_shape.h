// Shape and depth of a retina from points on it, as MRI gives them or a localizer that followed it
// (thesis 4.4).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <span>

namespace vitreo::optics {

struct RetinaFitOptions {
  bool fit_conic = true;   // else the conic constant stays at `conic`
  double conic = 0;        // -0.175 in the model eye of chapter 4
  bool fit_center = true;  // else the axis of the surface is that of the eye
};

/// A conicoid of revolution about a line parallel to the eye's axis, open towards +z:
/// (x-x0)^2 + (y-y0)^2 = 2 R (z-z0) - (1+k) (z-z0)^2, which is (3.1) without aspheric terms.
struct RetinaFit {
  // x0, y0, z0, m; z0 is the error of the assumed retinal depth
  Eigen::Vector3d vertex = Eigen::Vector3d::Zero();
  double radius = 0;        // R, m
  double conic = 0;         // k
  double rms_residual = 0;  // m, distances from the surface
  double max_residual = 0;
  // x0, y0, z0, R, k from the residuals; 0 where held or without spare points
  Eigen::Matrix<double, 5, 5> covariance = Eigen::Matrix<double, 5, 5>::Zero();
};

/// Least squares of the distances (to first order in them) from the surface. Throws
/// std::invalid_argument naming `points`: too few, not finite, or placed so that they do not
/// determine the surface (one circle, one plane, one line), or no surface that is concave towards
/// +z.
RetinaFit fit_retina(std::span<const Eigen::Vector3d> points, const RetinaFitOptions& options = {});

}  // namespace vitreo::optics
