// Outline of a body seen from a point, and the ellipse that a tracker fits to its image.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/pose/object_model.h"

#include <Eigen/Core>

#include <optional>
#include <vector>

namespace vitreo::optics::detail {

/// Points of the body (its own frame, m) along its outline as seen from `viewpoint` (same frame),
/// `count` of them, at equal angles round the line of sight through its center where the semi-axes
/// are 1. Nothing when the viewpoint does not lie well outside. For bodies other than ellipsoids
/// the points lie on chords of a 240-gon, less than 2e-4 of the size inside the true outline. Of
/// two that cross it is the outer one of both at each angle.
std::optional<std::vector<Eigen::Vector3d>> outline(const ObjectModel& body,
                                                    const Eigen::Vector3d& viewpoint, int count);

/// An ellipse in coordinates that stay smooth where it is a circle: center u and v, mean semi-axis
/// (a + b) / 2, and half the difference of the semi-axes times cosine and sine of twice the angle;
/// px.
using SmoothEllipse = Eigen::Matrix<double, 5, 1>;
SmoothEllipse smooth_ellipse(const Eigen::Matrix<double, 5, 1>& center_axes_angle);
Eigen::Matrix<double, 5, 1> center_axes_angle(const SmoothEllipse& ellipse);

/// How much a rim's point counts that lies off the ellipse.
enum class RimFit { least_squares, robust };

/// Least squares of distances where the ellipse is a circle, at equal steps of its parameter, as a
/// tracker fits it to the rim. `rim`: in order round it. Nothing for a rim that encloses no area.
/// `robust`: what sticks out by more than a pixel counts less, as for a tracker too.
std::optional<SmoothEllipse> rim_ellipse(const std::vector<Eigen::Vector2d>& rim,
                                         RimFit fit = RimFit::least_squares);

}  // namespace vitreo::optics::detail
