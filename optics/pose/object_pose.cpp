// SPDX-License-Identifier: Apache-2.0
#include "optics/pose/object_pose.h"

#include "optics/numerics/linear.h"
#include "optics/numerics/preconditions.h"
#include "optics/pose/body_outline.h"
#include "optics/pose/convex_silhouette.h"
#include "optics/pose/ellipse_weight.h"
#include "optics/pose/pose_search.h"

#include <Eigen/Dense>
#include <Eigen/Geometry>

#include <cmath>
#include <iterator>
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

/// (5.14) for a superquadric, or two ellipsoids that cross: the outline seen from the viewpoint
/// near the body, projected, and the ellipse that a tracker fits to it. The outline is computed in
/// the frame of the body at its nominal size: a body larger by `scale` is one seen from a viewpoint
/// nearer by that factor. Nothing where the viewpoint is too near, or a point of the outline has no
/// image.
std::optional<SmoothEllipse> sampled_ellipse(const ObjectPoseSettings& settings,
                                             const ProjectionModel& camera,
                                             const BodyState& state) {
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

/// Bodies whose parts are not all about the origin are taken for bodies of no symmetry: a pin has a
/// head.
detail::Symmetry symmetry_of(const ObjectModel& body) {
  for (const BodyPart& part : body.parts)
    if (!part.center.isZero(0)) return detail::Symmetry::none;
  return body.round_about_z() ? detail::Symmetry::about_z : detail::Symmetry::half_turns;
}

/// Points of an outline of which only the size is asked for, to start from.
constexpr int kFewPoints = 16;

/// The ellipse that a body shows, with its derivatives where the outline is in closed form. The
/// last one is kept: a solver asks for the derivatives where it has asked for the value, and starts
/// from near there.
class ShownEllipse {
 public:
  ShownEllipse(const ObjectPoseSettings& settings, const ProjectionModel& camera, int count)
      : settings_(settings),
        camera_(camera),
        parts_(settings.object.crossed ? std::vector<BodyPart>{}
                                       : detail::convex_parts(settings.object)),
        count_(count) {}

  std::optional<SmoothEllipse> at(const BodyState& state, Eigen::MatrixXd* per_state = nullptr) {
    if (parts_.empty()) return sampled_ellipse(settings_, camera_, state);
    const bool same = last_ && at_.position == state.position &&
                      at_.orientation == state.orientation && at_.scale == state.scale;
    if (!same) {
      const bool near = last_ && near_enough(state);
      const SmoothEllipse start = near ? last_->ellipse : SmoothEllipse::Zero();
      last_ = detail::outline_ellipse(parts_, camera_, state, count_, near ? &start : nullptr);
      at_ = state;
    }
    if (!last_) return std::nullopt;
    if (per_state) *per_state = last_->per_state;
    return last_->ellipse;
  }

 private:
  bool near_enough(const BodyState& state) const {
    constexpr double kPlace = 0.5e-3;  // m
    constexpr double kTurn = 0.1;      // rad
    return (state.position - at_.position).norm() < kPlace &&
           (state.orientation - at_.orientation).norm() < kTurn;
  }

  const ObjectPoseSettings& settings_;
  const ProjectionModel& camera_;
  std::vector<BodyPart> parts_;
  int count_;  // of points on the outline
  std::optional<detail::OutlineEllipse> last_;
  BodyState at_;
};

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
  const auto shown = ShownEllipse(settings, camera, settings.contour_points)
                         .at({pose.position_in_eye, pose.orientation, scale});
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
  ShownEllipse model(settings, camera, settings.contour_points);
  ShownEllipse rough(settings, camera, kFewPoints);
  measured.difference_px = [&](const BodyState& state,
                               Eigen::MatrixXd* per_state) -> std::optional<Eigen::VectorXd> {
    const auto shown = model.at(state, per_state);
    if (!shown) return std::nullopt;
    return Eigen::VectorXd(*shown - seen);
  };
  measured.size_px = [&](const BodyState& state) -> std::optional<double> {
    const auto shown = rough.at(state);
    if (!shown) return std::nullopt;
    return (*shown)[2];
  };
  measured.root = weight.root.topRows(weight.terms);
  measured.center_px = observed.head<2>();
  measured.size = seen[2];
  measured.symmetry = symmetry_of(settings.object);
  return detail::search_pose(settings, measured, start);
}

namespace {

/// An outline as a measurement: the lines of sight of its points, which no pose changes, and the
/// ellipse through them, of which center and size lead to a start.
struct SeenOutline {
  std::vector<detail::IsopixelLine> lines;
  Eigen::VectorXd weights;
  SmoothEllipse ellipse;
};

SeenOutline seen_outline(const ProjectionModel& camera, std::span<const OutlinePoint> outline) {
  constexpr std::size_t kFewest = 8;
  SeenOutline seen;
  std::vector<double> weights;
  std::vector<Eigen::Vector2d> rim;
  for (const OutlinePoint& point : outline) {
    detail::require(point.pixel_px.allFinite() && point.sigma_px > 0,
                    "outline: wants finite points with positive sigmas");
    detail::IsopixelLine line;
    if (!camera.sight(point.pixel_px, line)) continue;
    seen.lines.push_back(line);
    weights.push_back(1 / point.sigma_px);
    rim.push_back(point.pixel_px);
  }
  detail::require(rim.size() >= kFewest, "outline: wants at least eight points in the projection");
  seen.weights = Eigen::Map<const Eigen::VectorXd>(weights.data(), std::ssize(weights));
  const auto ellipse = detail::rim_ellipse(rim);
  if (!ellipse) throw std::invalid_argument("outline: encloses nothing, or is not in order");
  seen.ellipse = *ellipse;
  return seen;
}

/// Signed distances of all lines from the outline, px.
Eigen::VectorXd distances(std::span<const BodyPart> parts, const SeenOutline& seen,
                          const BodyState& state, Eigen::MatrixXd* per_state) {
  const auto count = std::ssize(seen.lines);
  Eigen::VectorXd off(count);
  if (per_state) per_state->resize(count, 7);
  for (Eigen::Index i = 0; i < count; ++i) {
    const auto one =
        detail::outline_distance(parts, state, seen.lines[static_cast<std::size_t>(i)]);
    off[i] = one.px;
    if (per_state) per_state->row(i) = one.per_state;
  }
  return off;
}

}  // namespace

/// Measurement: the distance of each point from the outline. Points outside of a body far off say
/// little of its place, so the starts are those of the ellipse through them.
ObjectPose locate_outline(const ObjectPoseSettings& settings, std::span<const OutlinePoint> outline,
                          const PoseStart& start) {
  constexpr double kTail = 3;  // sigma
  settings.check();
  check_start(settings, start);
  const std::vector<BodyPart> parts = detail::convex_parts(settings.object);
  detail::require(!parts.empty(), "object: its outline is not in closed form, only its ellipse");
  const ProjectionModel camera(settings.projection, settings.exact, settings.image);
  const SeenOutline seen = seen_outline(camera, outline);
  ShownEllipse rough(settings, camera, kFewPoints);
  detail::Measurement measured;
  measured.difference_px = [&](const BodyState& state,
                               Eigen::MatrixXd* per_state) -> std::optional<Eigen::VectorXd> {
    Eigen::VectorXd off = distances(parts, seen, state, per_state);
    if (!off.allFinite()) return std::nullopt;
    return off;
  };
  measured.size_px = [&](const BodyState& state) -> std::optional<double> {
    const auto shown = rough.at(state);
    if (!shown) return std::nullopt;
    return (*shown)[2];
  };
  measured.weights = seen.weights;
  measured.tail = kTail;
  measured.center_px = seen.ellipse.head<2>();
  measured.size = seen.ellipse[2];
  measured.symmetry = symmetry_of(settings.object);
  return detail::search_pose(settings, measured, start);
}

std::optional<std::vector<Eigen::Vector2d>> project_outline(const ObjectPoseSettings& settings,
                                                            const BodyPose& pose, int count) {
  settings.check();
  check_start(settings, {pose.position_in_eye, pose.orientation});
  detail::require_at_least(count, 3, "count");
  const std::vector<BodyPart> parts = detail::convex_parts(settings.object);
  detail::require(!parts.empty(), "object: its outline is not in closed form, only its ellipse");
  const ProjectionModel camera(settings.projection, settings.exact, settings.image);
  if (!camera.inside(pose.position_in_eye)) return std::nullopt;
  return detail::outline_points(parts, camera, {pose.position_in_eye, pose.orientation, 1}, count);
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
  measured.difference_px = [&](const BodyState& state,
                               Eigen::MatrixXd*) -> std::optional<Eigen::VectorXd> {
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
