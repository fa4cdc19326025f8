// Outline of a body of convex parts along the lines of sight of any projection: signed distances of
// image points from it, the ellipse fitted to it, and the exact derivatives of both.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/pose/body_part.h"
#include "optics/pose/convex_silhouette.h"
#include "optics/pose/pose_solver.h"
#include "optics/projection/projection_model.h"

#include <Eigen/Core>

#include <optional>
#include <span>
#include <vector>

namespace vitreo::optics::detail {

/// By position (m), rotation about the body's own axes (rad), logarithm of the size.
using PerState = Eigen::Matrix<double, 1, 7>;

/// A line of sight against the part that is nearest to it, or that it passes deepest: F < 0 inside
/// of the body's outline, 0 on it, > 0 outside; in units of that part's size.
struct OutlineTouch {
  double excess = 0;       // F = gauge - 1
  PerState per_state;      // dF
  Eigen::Vector2d per_px;  // dF by the pixel of the line
};
OutlineTouch touch_outline(std::span<const BodyPart> parts, const BodyState& state,
                           const IsopixelLine& line);
OutlineTouch touch_part(const BodyPart& part, const BodyState& state, const IsopixelLine& line);

/// Signed distance of an image point from the outline, px, positive outside, to second order, and
/// its derivative by the state.
struct OutlineDistance {
  double px = 0;
  PerState per_state;
};
OutlineDistance outline_distance(std::span<const BodyPart> parts, const BodyState& state,
                                 const IsopixelLine& line);

/// The outline in the image, `count` points at equal angles round the image of the body's origin,
/// px. Every part must hold the origin, so that the outline is star-shaped about it. Nothing where
/// part of it is outside the projection.
std::optional<std::vector<Eigen::Vector2d>> outline_points(std::span<const BodyPart> parts,
                                                           const ProjectionModel& camera,
                                                           const BodyState& state, int count);

/// The ellipse that a tracker fits: c + S q, q on the unit circle, where the outline is at
/// c + rho S q and the sum of (rho - 1) (1, cos, sin, cos 2, sin 2) over `count` equal steps of the
/// angle vanishes: least squares of distances where the ellipse is a circle.
struct OutlineEllipse {
  SmoothEllipse ellipse;
  Eigen::Matrix<double, 5, 7> per_state;  // exact, by the theorem of implicit functions
};
/// `near`: an ellipse to start from, as of a neighboring state; else it is found. Nothing outside
/// the projection, or where the outline encloses nothing.
std::optional<OutlineEllipse> outline_ellipse(std::span<const BodyPart> parts,
                                              const ProjectionModel& camera, const BodyState& state,
                                              int count, const SmoothEllipse* near = nullptr);

}  // namespace vitreo::optics::detail
