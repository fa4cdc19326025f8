// The silhouette of a spheroid through the exact chain, found without any of the localizer's code:
// an image point is inside when its traced isopixel line meets the spheroid. And the ellipse that a
// tracker would fit to it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/pose/pose.h"
#include "optics/rays/observer.h"

#include <Eigen/Core>

namespace vitreo::optics {

struct ExactScene {
  System system;
  Microscope microscope;
  ImageScale image;
  Spheroid robot;
};

/// How far the line passes outside the spheroid, as a squared distance where the spheroid is the
/// unit sphere, less 1.
double miss_distance(const ExactScene& scene, const Eigen::Vector3d& position,
                     const Eigen::Vector3d& axis, const Eigen::Vector2d& pixel);

constexpr int kExactContourPoints = 64;
using ExactContour = Eigen::Matrix<double, 2, kExactContourPoints>;

/// Contour points in px, equally spaced round `near` where that is a circle.
ExactContour exact_contour(const ExactScene& scene, const Eigen::Vector3d& position,
                           const Eigen::Vector3d& axis, const EllipseVector& near);

/// With `orthogonal`, by distances along the ellipse's normals (to first order); else where the
/// ellipse is a circle.
EllipseVector fit_ellipse(const ExactContour& contour, const EllipseVector& near, bool orthogonal);

}  // namespace vitreo::optics
