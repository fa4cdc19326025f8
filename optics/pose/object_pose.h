// Pose of a body of known shape from the ellipse that it shows or from points on it: thesis 5.3,
// weighted by the tracker's covariance, for ellipsoids, cylinders, superquadrics and points.
// Ambiguous poses and unobserved directions are reported.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/pose/body_pose.h"

#include <Eigen/Core>

#include <optional>
#include <span>
#include <vector>

namespace vitreo::optics {

/// The ellipse that a tracker fits to the body's silhouette. Nothing outside the projection.
std::optional<EllipseVector> project_object(const ObjectPoseSettings& settings,
                                            const BodyPose& pose, double scale = 1);

/// The same to a camera far away, about the body's center: `right` and `up`, unit, in the frame
/// that `orientation` takes the body to, are the image's axes; px of `pixel` m, v upwards.
std::optional<EllipseVector> distant_ellipse(const ObjectModel& object,
                                             const Eigen::Matrix3d& orientation,
                                             const Eigen::Vector3d& right,
                                             const Eigen::Vector3d& up, double pixel);

/// Weighted least squares (docs/localization.md). The tracker's angle has no weight where the
/// ellipse is round. Without a start's position from the center's line of sight, at the depth where
/// the size fits and 3 mm before and behind; with `rotate` from tilted starts too (without an
/// orientation from six), and from the mirror image of what was found, tilted the other way against
/// the line of sight. Throws std::invalid_argument naming a bad argument.
ObjectPose locate_object(const ObjectPoseSettings& settings, const EllipseVector& observed,
                         const EllipseCovariance& covariance, const PoseStart& start);

/// A point of the outline in the image, as a tracker finds it along a normal of the rim.
struct OutlinePoint {
  Eigen::Vector2d pixel_px;
  double sigma_px = 0.2;  // across the outline
};

/// The same from the outline itself, which shows more than its ellipse: corners, plates, a needle.
/// Points count by their distance from the body's outline, those beyond 3 sigma less
/// (pseudo-Huber). The body must be of convex parts (ObjectModel::parts), an ellipsoid or a
/// cylinder. At least eight points within the projection are needed; those outside are left out.
/// Throws std::invalid_argument naming a bad argument.
ObjectPose locate_outline(const ObjectPoseSettings& settings, std::span<const OutlinePoint> outline,
                          const PoseStart& start);

/// `count` points of the body's outline, in order round it; px. Nothing outside the projection.
std::optional<std::vector<Eigen::Vector2d>> project_outline(const ObjectPoseSettings& settings,
                                                            const BodyPose& pose, int count);

/// A point that is known on the body, and the pixel that shows it.
struct SeenPoint {
  Eigen::Vector3d in_body;                                          // m
  Eigen::Vector2d pixel_px;                                         // px
  Eigen::Matrix2d covariance = 0.04 * Eigen::Matrix2d::Identity();  // px^2; 0.2 px
};

/// The same from points; `settings.object` is not used. One point leaves the depth unobserved, two
/// or three in a line the rotation about it, and three have up to four poses. Without an
/// orientation it starts from 24.
ObjectPose locate_points(const ObjectPoseSettings& settings, std::span<const SeenPoint> points,
                         const PoseStart& start);

}  // namespace vitreo::optics
