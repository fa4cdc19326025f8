// SPDX-License-Identifier: Apache-2.0
#include "optics/pose/body_outline.h"

#include "optics/numerics/linear.h"

#include <Eigen/Dense>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

namespace vitreo::optics::detail {
namespace {

using Vector = Eigen::Vector3d;
constexpr double kTurn = 2 * std::numbers::pi;

/// A line of sight in the frame of the body at its nominal size.
struct LineInBody {
  Vector origin;
  Vector direction;
  LineInBody(const BodyState& state, const IsopixelLine& line) {
    const Vector at(line.at_retina.x(), line.at_retina.y(), 0);
    const Vector along(line.slope.x(), line.slope.y(), 1);
    origin = state.orientation.transpose() * (at - state.position) / state.scale;
    direction = state.orientation.transpose() * along;
  }
};

/// A change of the state moves the line against the body: at the point of contact q by -R'dp for
/// the position, -w x q for a rotation w about the body's axes, -q for the size. A displacement x
/// there changes the gauge by n . x / h.
OutlineTouch with_derivatives(const Tangency& touched, const BodyState& state,
                              const IsopixelLine& line) {
  OutlineTouch made;
  made.excess = touched.gauge - 1;
  const double per = 1 / touched.support;
  const Vector in_eye = state.orientation * touched.normal * (per / state.scale);
  made.per_state.head<3>() = -in_eye;
  made.per_state.segment<3>(3) = -per * touched.point.cross(touched.normal);
  made.per_state[6] = -per * touched.normal.dot(touched.point);
  const double z = state.position.z() + state.scale * state.orientation.row(2).dot(touched.point);
  made.per_px = line.per_m(z).transpose() * in_eye.head<2>();
  return made;
}

/// A ray of the image from `from` along `step`, in units of `step`, and the projection that it is
/// looked at through.
struct ImageRay {
  const ProjectionModel& camera;
  Eigen::Vector2d from;
  Eigen::Vector2d step;
};

struct Crossing {
  double rho = 0;
  OutlineTouch touch;
  double per_rho = 0;  // dF along the ray
};

/// Where a ray leaves one part. F is convex along the ray, nearly of first degree from the part's
/// middle: Newton's method, from `rho` or, where F falls outwards there, from farther out. Nothing
/// where the ray misses the part, or the end lies outside of the projection.
std::optional<Crossing> leave(const BodyPart& part, const BodyState& state, const ImageRay& ray,
                              double rho) {
  constexpr int kSteps = 40;
  constexpr double kNear = 1e-6;  // relative: the step after such a step is its square
  constexpr double kFarther = 1.6;
  constexpr double kNearer = 0.85;  // where a step has left the projection
  constexpr double kLongest = 2;    // factor by which a step may lengthen
  constexpr double kFarthest = 1e3;
  IsopixelLine line;
  for (int i = 0; i < kSteps && rho < kFarthest; ++i) {
    if (!ray.camera.sight(ray.from + rho * ray.step, line)) {
      rho *= kNearer;
      continue;
    }
    Crossing made{rho, touch_part(part, state, line), 0};
    made.per_rho = made.touch.per_px.dot(ray.step);
    if (!(made.per_rho > 0)) {
      rho *= kFarther;
      continue;
    }
    const double next = std::min(rho - made.touch.excess / made.per_rho, kLongest * rho);
    if (!(next > 0)) return std::nullopt;  // it lies behind the ray's start
    const bool last = std::abs(next - rho) < kNear * rho;
    rho = made.rho = next;
    if (last) return made;
  }
  return std::nullopt;
}

/// Where a ray leaves the body: the farthest of its parts' ends. `rho` is the start and the result.
std::optional<Crossing> leave(std::span<const BodyPart> parts, const BodyState& state,
                              const ImageRay& ray, double rho) {
  std::optional<Crossing> farthest;
  for (const BodyPart& part : parts) {
    auto made = leave(part, state, ray, rho);
    if (made && (!farthest || made->rho > farthest->rho)) farthest = std::move(made);
  }
  return farthest;
}

/// The image near the body's origin, to first order: pixel = middle + per_point (x - position).
struct AffineView {
  Eigen::Vector2d middle;
  Eigen::Matrix<double, 2, 3> per_point;
};

std::optional<AffineView> affine_view(const ProjectionModel& camera, const BodyState& state) {
  const auto middle = camera.pixel(state.position);
  IsopixelLine line;
  if (!middle || !camera.sight(*middle, line)) return std::nullopt;
  const Eigen::Matrix2d per_x = line.per_m(state.position.z()).inverse();
  if (!per_x.allFinite()) return std::nullopt;
  AffineView view{*middle, {}};
  view.per_point << per_x, -per_x * line.slope;
  return view;
}

/// S S^T of the ellipse that the parts' semi-axes make in the image: an ellipsoid's own to first
/// order, of other bodies about the size and the direction.
Eigen::Matrix2d about_shape(std::span<const BodyPart> parts, const AffineView& view,
                            const BodyState& state) {
  Eigen::Matrix2d sum = Eigen::Matrix2d::Zero();
  for (const BodyPart& part : parts) {
    const Eigen::Matrix<double, 2, 3> axes = view.per_point * state.orientation * part.orientation *
                                             (state.scale * part.semi_axes).asDiagonal();
    sum += axes * axes.transpose() / static_cast<double>(parts.size());
  }
  return sum;
}

/// The fit's five unknowns: center, and the symmetric shape S as (Sxx, Sxy, Syy).
using Fit = Eigen::Matrix<double, 5, 1>;
using Fit5 = Eigen::Matrix<double, 5, 5>;

Fit fit_from(const SmoothEllipse& e) {
  Fit fit;
  fit << e[0], e[1], e[2] + e[3], e[4], e[2] - e[3];
  return fit;
}

/// With S symmetric, its half trace is the mean semi-axis and its traceless part the vector of
/// twice the angle: smooth coordinates are linear in the fit's.
Fit5 smooth_from_fit() {
  Fit5 by = Fit5::Zero();
  by(0, 0) = by(1, 1) = 1;
  by(2, 2) = by(2, 4) = 0.5;
  by(3, 2) = 0.5, by(3, 4) = -0.5;
  by(4, 3) = 1;
  return by;
}

/// The fit's equations G = sum (rho - 1) b(q) at one ellipse, and their derivatives.
struct Equations {
  Fit value = Fit::Zero();
  Fit5 per_fit = Fit5::Zero();
  Eigen::Matrix<double, 5, 7> per_state = Eigen::Matrix<double, 5, 7>::Zero();
};

/// At a crossing F = 0 holds for all ellipses and states: d rho = -(dF/dstate + dF/dpx . d(c + rho
/// S q)) / (dF/dpx . S q).
void add_crossing(const Crossing& at, const Eigen::Vector2d& q, Equations& sum) {
  Fit row;
  row << q.x(), q.y(), 1, q.x() * q.x() - q.y() * q.y(), 2 * q.x() * q.y();
  const Eigen::Vector2d g = at.touch.per_px / -at.per_rho;
  const Eigen::Vector2d r = at.rho * q;
  Eigen::Matrix<double, 1, 5> per_fit;
  per_fit << g.x(), g.y(), g.x() * r.x(), g.x() * r.y() + g.y() * r.x(), g.y() * r.y();
  sum.value += (at.rho - 1) * row;
  sum.per_fit += row * per_fit;
  sum.per_state += row * (at.touch.per_state / -at.per_rho);
}

/// Newton's method on G = 0; the rays' lengths are kept from round to round as starts.
class EllipseFit {
 public:
  EllipseFit(std::span<const BodyPart> parts, const ProjectionModel& camera, const BodyState& state,
             int count)
      : parts_(parts), camera_(camera), state_(state), lengths_(count, 1.0) {}

  std::optional<OutlineEllipse> from(Fit fit) {
    constexpr int kRounds = 25;
    constexpr double kSmall = 1e-5;   // px: the step after it is its square over the size
    constexpr double kKinked = 1e-3;  // px: between two parts a ray's length has two slopes
    double last = std::numeric_limits<double>::infinity();
    for (int i = 0; i < kRounds; ++i) {
      if (!set_up(fit)) return std::nullopt;
      const Fit step = -sum_.per_fit.partialPivLu().solve(sum_.value);
      if (!step.allFinite()) return std::nullopt;
      // A step may not turn the ellipse inside out.
      const double most = 0.5 * std::min(fit[2], fit[4]);
      const double longest = step.tail<3>().cwiseAbs().maxCoeff();
      fit += std::min(1.0, most / std::max(longest, 1e-12)) * step;
      if (!(fit[2] * fit[4] > fit[3] * fit[3])) return std::nullopt;
      last = step.cwiseAbs().maxCoeff();
      if (last < kSmall) break;
    }
    if (!(last < kKinked)) return std::nullopt;
    return result(fit);
  }

 private:
  bool set_up(const Fit& fit) {
    sum_ = Equations{};
    const auto count = lengths_.size();
    for (std::size_t i = 0; i < count; ++i) {
      const double angle = kTurn * static_cast<double>(i) / static_cast<double>(count);
      const Eigen::Vector2d q(std::cos(angle), std::sin(angle));
      const Eigen::Vector2d step(fit[2] * q.x() + fit[3] * q.y(), fit[3] * q.x() + fit[4] * q.y());
      const auto at = leave(parts_, state_, {camera_, fit.head<2>(), step}, lengths_[i]);
      if (!at) return false;
      lengths_[i] = at->rho;
      add_crossing(*at, q, sum_);
    }
    return true;
  }

  OutlineEllipse result(const Fit& fit) const {
    static const Fit5 smooth = smooth_from_fit();
    return {smooth * fit, -smooth * sum_.per_fit.partialPivLu().solve(sum_.per_state)};
  }

  std::span<const BodyPart> parts_;
  const ProjectionModel& camera_;
  const BodyState& state_;
  std::vector<double> lengths_;
  Equations sum_;
};

}  // namespace

OutlineTouch touch_part(const BodyPart& part, const BodyState& state, const IsopixelLine& line) {
  const LineInBody in_body(state, line);
  return with_derivatives(touch(part, in_body.origin, in_body.direction), state, line);
}

/// The least signed distance decides: outside it belongs to the nearest part, inside to the
/// deepest.
OutlineTouch touch_outline(std::span<const BodyPart> parts, const BodyState& state,
                           const IsopixelLine& line) {
  const LineInBody in_body(state, line);
  Tangency nearest;
  double least = std::numeric_limits<double>::infinity();
  for (const BodyPart& part : parts) {
    const Tangency touched = touch(part, in_body.origin, in_body.direction);
    if (!(touched.distance() < least)) continue;
    least = touched.distance();
    nearest = touched;
  }
  return with_derivatives(nearest, state, line);
}

/// The line of the nearest point of the outline is the point's own, moved by the distance across:
/// the derivative of a distance is that of its foot. Not from deep within the body, where a step of
/// first order may lead across it.
OutlineDistance outline_distance(std::span<const BodyPart> parts, const BodyState& state,
                                 const IsopixelLine& line) {
  const OutlineTouch touched = touch_outline(parts, state, line);
  constexpr double kNear = 0.25;  // of the body's size
  const double slope2 = touched.per_px.squaredNorm();
  if (touched.excess < -kNear) {
    const double per = 1 / std::sqrt(slope2);
    return {touched.excess * per, touched.per_state * per};
  }
  const Eigen::Vector2d to_foot = -touched.excess / slope2 * touched.per_px;
  IsopixelLine foot = line;
  foot.at_retina += line.at_retina_per_m * to_foot;
  foot.slope += line.slope_per_m * to_foot;
  const OutlineTouch there = touch_outline(parts, state, foot);
  const double per = 1 / there.per_px.norm();
  return {touched.excess / std::sqrt(slope2) + there.excess * per, there.per_state * per};
}

std::optional<std::vector<Eigen::Vector2d>> outline_points(std::span<const BodyPart> parts,
                                                           const ProjectionModel& camera,
                                                           const BodyState& state, int count) {
  const auto view = affine_view(camera, state);
  if (!view) return std::nullopt;
  const double size = std::sqrt(about_shape(parts, *view, state).trace());
  std::vector<Eigen::Vector2d> points;
  points.reserve(static_cast<std::size_t>(count));
  double rho = 1;
  for (int i = 0; i < count; ++i) {
    const double angle = kTurn * i / count;
    const Eigen::Vector2d step = size * Eigen::Vector2d(std::cos(angle), std::sin(angle));
    const auto at = leave(parts, state, {camera, view->middle, step}, rho);
    if (!at) return std::nullopt;
    rho = at->rho;
    points.push_back(view->middle + rho * step);
  }
  return points;
}

namespace {

/// A start for the fit: the ellipse through the outline's points at equal steps of the angle round
/// an ellipse of about its shape. From farther off Newton's method may end at another solution, as
/// where plates cross.
std::optional<SmoothEllipse> about_ellipse(std::span<const BodyPart> parts,
                                           const ProjectionModel& camera, const BodyState& state,
                                           int count) {
  const auto view = affine_view(camera, state);
  if (!view) return std::nullopt;
  const Eigen::Matrix2d shape = square_root(about_shape(parts, *view, state));
  if (!shape.allFinite()) return std::nullopt;
  std::vector<Eigen::Vector2d> rim;
  rim.reserve(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) {
    const double angle = kTurn * i / count;
    const Eigen::Vector2d step = shape * Eigen::Vector2d(std::cos(angle), std::sin(angle));
    const auto at = leave(parts, state, {camera, view->middle, step}, 1);
    if (!at) return std::nullopt;
    rim.push_back(view->middle + at->rho * step);
  }
  return rim_ellipse(rim);
}

}  // namespace

std::optional<OutlineEllipse> outline_ellipse(std::span<const BodyPart> parts,
                                              const ProjectionModel& camera, const BodyState& state,
                                              int count, const SmoothEllipse* near) {
  if (near) {
    if (auto found = EllipseFit(parts, camera, state, count).from(fit_from(*near))) return found;
  }
  const auto start = about_ellipse(parts, camera, state, count);
  if (!start) return std::nullopt;
  return EllipseFit(parts, camera, state, count).from(fit_from(*start));
}

}  // namespace vitreo::optics::detail
