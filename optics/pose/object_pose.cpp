// SPDX-License-Identifier: Apache-2.0
#include "optics/pose/object_pose.h"

#include "optics/numerics/linear.h"
#include "optics/numerics/preconditions.h"
#include "optics/pose/convex_silhouette.h"
#include "optics/pose/ellipse_weight.h"
#include "optics/pose/pose_search.h"

#include <Eigen/Dense>
#include <Eigen/Geometry>

#include <cmath>
#include <stdexcept>
#include <string>

namespace vitreo::optics {
namespace {

using detail::BodyState;
using detail::ProjectionModel;
using detail::SmoothEllipse;

/// A plate that is seen edge-on sticks out of the other one's ellipse, and a tracker leaves it out.
detail::RimFit fit_of(const ObjectModel& object) {
  return object.crossed ? detail::RimFit::robust : detail::RimFit::least_squares;
}

/// (5.14) for a body: the outline seen from the viewpoint near the body, projected, and the
/// ellipse that a tracker fits to it. The outline is computed in the frame of the body at its
/// nominal size: a body larger by `scale` is one seen from a viewpoint nearer by that factor.
/// Nothing where the viewpoint is too near, or a point of the outline has no image.
std::optional<SmoothEllipse> shown_ellipse(const ObjectPoseSettings& settings,
                                           const ProjectionModel& camera, const BodyState& state) {
  const auto viewpoint = camera.viewpoint(state.position);
  if (!viewpoint) return std::nullopt;
  const Eigen::Vector3d from =
      state.orientation.transpose() * (*viewpoint - state.position) / state.scale;
  const auto points = detail::outline(settings.object, from, settings.contour_points);
  if (!points) return std::nullopt;
  std::vector<Eigen::Vector2d> rim;
  rim.reserve(points->size());
  for (const Eigen::Vector3d& point : *points) {
    const auto pixel = camera.pixel(state.position + state.orientation * (state.scale * point));
    if (!pixel) return std::nullopt;
    rim.push_back(*pixel);
  }
  return detail::rim_ellipse(rim, fit_of(settings.object));
}

/// An orientation is needed where it is held, or known beforehand; it must be a proper rotation.
/// Throws std::invalid_argument naming position or orientation; 1e-9 admits rotations that were
/// composed of many.
void check_start(const ObjectPoseSettings& settings, const PoseStart& start) {
  if (start.position_in_eye && !start.position_in_eye->allFinite()) {
    throw std::invalid_argument("position: must be finite");
  }
  const bool known = std::isfinite(settings.orientation_sigma);
  if (!start.orientation) {
    if (settings.rotate && !known) return;
    throw std::invalid_argument("orientation: is needed unless the body may rotate freely");
  }
  const Eigen::Matrix3d& turn = *start.orientation;
  const bool rotation =
      turn.allFinite() && (turn.transpose() * turn).isIdentity(1e-9) && turn.determinant() > 0;
  if (!rotation) throw std::invalid_argument("orientation: must be a rotation");
}

/// Block diagonal, of the inverse Cholesky factors of the points' covariances: independent terms of
/// unit variance.
/// Throws std::invalid_argument naming the points for a covariance that has no inverse.
Eigen::MatrixXd point_weights(std::span<const SeenPoint> points) {
  const auto count = static_cast<Eigen::Index>(points.size());
  Eigen::MatrixXd root = Eigen::MatrixXd::Zero(2 * count, 2 * count);
  for (Eigen::Index i = 0; i < count; ++i) {
    const SeenPoint& point = points[static_cast<std::size_t>(i)];
    detail::require(
        point.in_body.allFinite() && point.pixel_px.allFinite() && point.covariance.allFinite(),
        "points: must be finite");
    const Eigen::LLT<Eigen::Matrix2d> factor(point.covariance);
    const bool symmetric = std::abs(point.covariance(0, 1) - point.covariance(1, 0)) <=
                           1e-9 * point.covariance.trace();
    if (factor.info() != Eigen::Success || !symmetric) {
      throw std::invalid_argument("points: a covariance must be symmetric and positive definite");
    }
    root.block<2, 2>(2 * i, 2 * i) = factor.matrixL().solve(Eigen::Matrix2d::Identity());
  }
  return root;
}

/// Normal of the plane that the points lie in best: the direction of least spread. A flat set of
/// points is its own mirror image in that plane.
/// In the body's frame. For points in one plane the mirror image in it is the points themselves,
/// for others nearly so.
Eigen::Vector3d flattest(std::span<const SeenPoint> points) {
  Eigen::Vector3d mean(0, 0, 0);
  for (const SeenPoint& point : points) mean += point.in_body / static_cast<double>(points.size());
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  for (const SeenPoint& point : points)
    spread += (point.in_body - mean) * (point.in_body - mean).transpose();
  return detail::spectrum_of(spread).vectors.col(0);
}

/// (5.14) for points.
/// Nothing as soon as one point has no image: with fewer residuals the minimum would be another
/// one.
std::optional<Eigen::VectorXd> shown_points(std::span<const SeenPoint> points,
                                            const ProjectionModel& camera, const BodyState& state) {
  Eigen::VectorXd shown(2 * static_cast<Eigen::Index>(points.size()));
  for (std::size_t i = 0; i < points.size(); ++i) {
    const auto pixel =
        camera.pixel(state.position + state.orientation * (state.scale * points[i].in_body));
    if (!pixel) return std::nullopt;
    shown.segment<2>(2 * static_cast<Eigen::Index>(i)) = *pixel;
  }
  return shown;
}

/// Root mean square distance of pixels from their mean.
/// Stands in for an ellipse's size where a start depth is sought; one point has none.
double spread(const Eigen::VectorXd& pixels) {
  const Eigen::Index count = pixels.size() / 2;
  const auto each = pixels.reshaped(2, count);
  return std::sqrt((each.colwise() - each.rowwise().mean()).squaredNorm() /
                   static_cast<double>(count));
}

}  // namespace

/// (5.14) and the ellipse of its silhouette.
std::optional<EllipseVector> project_object(const ObjectPoseSettings& settings,
                                            const BodyPose& pose, double scale) {
  settings.check();
  check_start(settings, {pose.position_in_eye, pose.orientation});
  detail::require_positive(scale, "scale");
  const ProjectionModel camera(settings.projection, settings.exact, settings.image);
  if (!camera.inside(pose.position_in_eye)) return std::nullopt;
  const auto shown =
      shown_ellipse(settings, camera, {pose.position_in_eye, pose.orientation, scale});
  if (!shown) return std::nullopt;
  return detail::center_axes_angle(*shown);
}

/// Parallel lines of sight, as from a thousand times the body's size away.
std::optional<EllipseVector> distant_ellipse(const ObjectModel& object,
                                             const Eigen::Matrix3d& orientation,
                                             const Eigen::Vector3d& right,
                                             const Eigen::Vector3d& up, double pixel) {
  constexpr int kPoints = 64;
  object.check();
  detail::require_positive(pixel, "pixel");
  const double far = 1000 * object.semi_axes.maxCoeff();
  const Eigen::Vector3d from = orientation.transpose() * (far * right.cross(up));
  const auto points = detail::outline(object, from, kPoints);
  if (!points) return std::nullopt;
  std::vector<Eigen::Vector2d> rim;
  rim.reserve(points->size());
  for (const Eigen::Vector3d& point : *points) {
    const Eigen::Vector3d turned = orientation * point;
    rim.emplace_back(turned.dot(right) / pixel, turned.dot(up) / pixel);
  }
  const auto shown = detail::rim_ellipse(rim, fit_of(object));
  if (!shown) return std::nullopt;
  return detail::center_axes_angle(*shown);
}

/// Measurement: the five smooth coordinates of the ellipse; its size is the mean semi-axis.
/// Not the axes and the angle, which are undefined at a circle and exchange where a body turns;
/// ellipse_weight brings the covariance into the same coordinates.
ObjectPose locate_object(const ObjectPoseSettings& settings, const EllipseVector& observed,
                         const EllipseCovariance& covariance, const PoseStart& start) {
  settings.check();
  detail::check_ellipse(observed);
  check_start(settings, start);
  const ProjectionModel camera(settings.projection, settings.exact, settings.image);
  const SmoothEllipse seen = detail::smooth_ellipse(observed);
  const detail::EllipseWeight weight = detail::ellipse_weight(observed, covariance);
  detail::Measurement measured;
  measured.difference_px = [&](const BodyState& state) -> std::optional<Eigen::VectorXd> {
    const auto shown = shown_ellipse(settings, camera, state);
    if (!shown) return std::nullopt;
    return Eigen::VectorXd(*shown - seen);
  };
  measured.size_px = [&](const BodyState& state) -> std::optional<double> {
    const auto shown = shown_ellipse(settings, camera, state);
    if (!shown) return std::nullopt;
    return (*shown)[2];
  };
  measured.root = weight.root.topRows(weight.terms);
  measured.center_px = observed.head<2>();
  measured.size = seen[2];
  measured.symmetry =
      settings.object.round_about_z() ? detail::Symmetry::about_z : detail::Symmetry::half_turns;
  return detail::search_pose(settings, measured, start);
}

/// Measurement: the pixels; their size is the spread about the mean.
/// Weighted by each point's own covariance.
ObjectPose locate_points(const ObjectPoseSettings& settings, std::span<const SeenPoint> points,
                         const PoseStart& start) {
  settings.check();
  check_start(settings, start);
  if (points.empty()) throw std::invalid_argument("points: wants at least one");
  const ProjectionModel camera(settings.projection, settings.exact, settings.image);
  Eigen::VectorXd seen(2 * static_cast<Eigen::Index>(points.size()));
  detail::Measurement measured;
  measured.root = point_weights(points);
  for (std::size_t i = 0; i < points.size(); ++i) {
    seen.segment<2>(2 * static_cast<Eigen::Index>(i)) = points[i].pixel_px;
    measured.center_px += points[i].pixel_px / static_cast<double>(points.size());
  }
  measured.difference_px = [&](const BodyState& state) -> std::optional<Eigen::VectorXd> {
    const auto shown = shown_points(points, camera, state);
    if (!shown) return std::nullopt;
    return Eigen::VectorXd(*shown - seen);
  };
  measured.size_px = [&](const BodyState& state) -> std::optional<double> {
    const auto shown = shown_points(points, camera, state);
    if (!shown) return std::nullopt;
    return spread(*shown);
  };
  measured.size = spread(seen);
  measured.mirror = flattest(points);
  return detail::search_pose(settings, measured, start);
}

}  // namespace vitreo::optics
