// SPDX-License-Identifier: Apache-2.0
#include "optics/pose/equivalent_ellipse.h"

#include "optics/pose/convex_silhouette.h"
#include "optics/pose/pose.h"
#include "optics/projection/projection_model.h"

namespace vitreo::optics {

/// In smooth coordinates, where round ellipses and ones that turn from long to wide make no steps;
/// by the ratio of the mean semi-axes for the size.
std::optional<EllipseVector> as_of_spheroid(const ObjectPoseSettings& body,
                                            const EllipseVector& seen,
                                            const Eigen::Vector3d& axis_in_eye,
                                            const Eigen::Vector3d& near_in_eye) {
  detail::check_ellipse(seen);
  const BodyPose pose{near_in_eye, orientation_along(axis_in_eye)};
  ObjectPoseSettings round = body;
  round.object = ellipsoid(body.object.semi_axes);
  const auto own = project_object(body, pose);
  const auto other = project_object(round, pose);
  if (!own || !other) return std::nullopt;
  const detail::SmoothEllipse from = detail::smooth_ellipse(*own);
  const detail::SmoothEllipse measured = detail::smooth_ellipse(seen);
  return detail::center_axes_angle(measured +
                                   measured[2] / from[2] * (detail::smooth_ellipse(*other) - from));
}

/// How the two differ hardly depends on the depth, so that the depth found by one that was
/// converted at a wrong one is the right place to convert at: two rounds. A view that is not
/// calibrated may find none; then it is somewhere in the eye.
std::optional<EllipseVector> as_of_spheroid(const ObjectPoseSettings& body,
                                            const EllipseVector& seen,
                                            const Eigen::Vector3d& axis_in_eye) {
  PoseSettings round;
  round.projection = body.projection;
  round.exact = body.exact;
  round.image = body.image;
  round.robot = {body.object.semi_axes.z(), body.object.semi_axes.x()};
  const detail::ProjectionModel camera(body.projection, body.exact, body.image);
  const auto sight = camera.line_of_sight(seen.head<2>());
  if (!sight) return std::nullopt;
  constexpr double kSomewhere = 0.3;  // of the depth that the projection reaches
  const double along = (kSomewhere * camera.max_z() - sight->origin.z()) / sight->direction.z();
  const Eigen::Vector3d somewhere = sight->origin + along * sight->direction;
  std::optional<EllipseVector> made = as_of_spheroid(body, seen, axis_in_eye, somewhere);
  if (!made) return std::nullopt;
  const auto place = first_guess(round, *made, axis_in_eye);
  return place ? as_of_spheroid(body, seen, axis_in_eye, *place) : made;
}

}  // namespace vitreo::optics
