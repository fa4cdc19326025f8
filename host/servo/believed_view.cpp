// SPDX-License-Identifier: Apache-2.0
#include "host/servo/believed_view.h"

#include "host/servo/robot_outline.h"
#include "optics/pose/object_pose.h"
#include "optics/pose/pose.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo {
namespace {

constexpr double kOutlineSigma_px = 0.1;

/// m: so far behind the believed retina a robot may be found. On benches that were set up by hand
/// robots at rest were found up to 0.6 mm below it, in eyes by thesis table 5.1 up to 1 mm
/// (docs/localization.md).
constexpr double kBehindRetina = 2e-3;

/// Standard deviations of a tenth of a pixel for center and semi-axes a, b; the angle's follows
/// from them, sigma / (sqrt(2) (a - b)), and is bounded where the outline is round.
vision::EllipseMeasurement good_outline(const vision::Ellipse& ellipse) {
  const double variance = kOutlineSigma_px * kOutlineSigma_px;
  const double difference = ellipse.semi_major_px - ellipse.semi_minor_px;
  vision::EllipseMeasurement seen{ellipse, variance * Eigen::Matrix<double, 5, 5>::Identity(), 1,
                                  0};
  seen.covariance(4, 4) =
      std::min(variance / 2 / std::max(difference * difference, 1e-12), M_PI * M_PI / 12);
  return seen;
}

}  // namespace

optics::PoseSettings pose_settings_of(const RigModel& model) {
  optics::PoseSettings pose;
  pose.projection = model.projection;
  pose.exact = model.exact;
  pose.image = model.top_image;
  pose.robot = {model.robot.semi_axis, model.robot.semi_radius};
  pose.behind_retina = kBehindRetina;
  return pose;
}

optics::ObjectPoseSettings object_settings_of(const RigModel& model,
                                              const optics::ObjectModel& object) {
  optics::ObjectPoseSettings settings;
  settings.projection = model.projection;
  settings.exact = model.exact;
  settings.image = model.top_image;
  settings.object = object;
  settings.behind_retina = kBehindRetina;
  return settings;
}

BelievedView::BelievedView(const RigModel& model, const CameraInfo& camera,
                           const Eigen::Vector3d& axis)
    : pose_(pose_settings_of(model)),
      eye_in_world_(model.eye_in_world),
      plain_view_(model.plain_view),
      size_px_(camera.width_px, camera.height_px),
      axis_(axis) {
  if (!(std::abs(axis.norm() - 1) < 1e-6)) throw std::invalid_argument("axis: must be a unit");
  if (has_flat_ends(model.robot) && !plain_view_)
    flat_ended_ = object_settings_of(model, *outlined_body(model.robot));
}

std::optional<vision::EllipseMeasurement> BelievedView::ellipse_at(
    const Eigen::Vector3d& position) const {
  const auto ellipse = plain_view_ ? from_above(position) : through_eye(position);
  if (!ellipse) return std::nullopt;
  const Eigen::Vector2d& center = ellipse->center_px;
  if ((center.array() < 0).any() || (center.array() > size_px_.array() - 1).any())
    return std::nullopt;
  return good_outline(*ellipse);
}

/// The axes of eye and world are parallel.
std::optional<vision::Ellipse> BelievedView::through_eye(const Eigen::Vector3d& position) const {
  const Eigen::Vector3d in_eye = position - eye_in_world_;
  const auto seen =
      flat_ended_ ? optics::project_object(*flat_ended_, {in_eye, optics::orientation_along(axis_)})
                  : optics::project_spheroid(pose_, in_eye, axis_);
  if (!seen) return std::nullopt;
  return vision::Ellipse{seen->head<2>(), (*seen)[2], (*seen)[3], (*seen)[4]};
}

/// The shadow of a spheroid with semi-axes a along d and b across: an ellipse whose squared shape
/// is b^2 I + (a^2 - b^2) d d^T, d the axis in the image, where v points down.
vision::Ellipse BelievedView::from_above(const Eigen::Vector3d& position) const {
  const double a = pose_.robot.semi_axis / pose_.image.pixel;
  const double b = pose_.robot.semi_radius / pose_.image.pixel;
  const Eigen::Vector2d d(axis_.x(), -axis_.y());
  const double along = std::sqrt(b * b + (a * a - b * b) * d.squaredNorm());
  const Eigen::Vector2d center = pose_.image.pixel_from_m(-position.head<2>());
  if (d.squaredNorm() == 0) return {center, b, b, 0};
  const Eigen::Vector2d unit = d.normalized();
  return vision::Ellipse::from_shape(
      center, b * Eigen::Matrix2d::Identity() + (along - b) * unit * unit.transpose());
}

}  // namespace vitreo
