// SPDX-License-Identifier: Apache-2.0
#include "optics/maps/wide_angle_map.h"

#include "optics/numerics/preconditions.h"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace vitreo::optics {
namespace {

constexpr double kSlack = 1e-9;  // m: a point computed to lie on the table's edge is on it
// of the table's sides: how far Newton's method may stray on its way
constexpr double kStray = 0.05;
constexpr double kMaxTail = 0.5e-6;  // m
// m; nearer to a fold the inverse would be off by more, so there is none
constexpr double kMaxRoundTrip = 5e-6;
constexpr int kMaxSteps = 30;
constexpr double kConverged = 1e-12;  // m, of an image

/// The stop's surface; of a system without one, where the thesis' tables have it.
int stop_surface(const System& system) {
  return system.stop ? system.stop->surface : std::min(3, system.size());
}

/// The system with its lens at the distance asked for. For a microscope the stop lets everything
/// through, so that the table reaches past the iris' shadow, whose edge is no smooth curve in it;
/// whether a point lies in the shadow is decided by its chief ray.
/// Throws std::invalid_argument naming the setting, or the surface where the lens' distance makes
/// the system unsound.
System resolved(const System& system, const WideAngleSettings& settings) {
  constexpr double kWide = 1;  // m
  settings.check();
  system.check();
  if (!system.stop && !settings.microscope)
    throw std::invalid_argument("stop: the system has none to be filled");
  System made =
      settings.lens_distance ? with_lens_distance(system, *settings.lens_distance) : system;
  if (settings.microscope) made.stop = Stop{stop_surface(system), kWide};
  made.check();
  return made;
}

/// The eye's stop for a bare sensor, else the microscope's own aperture.
Pupil first_pupil(const System& system, const WideAngleSettings& settings) {
  return settings.microscope ? Pupil::of_microscope(system, *settings.microscope)
                             : Pupil::of_stop(system);
}

/// A decentered telecentric microscope takes the same rays as a centered one.
/// Without symmetry the map needs two angles: as many bundles more as a skew table has arms.
bool is_symmetric(const System& system, const std::optional<Microscope>& microscope) {
  return system.is_symmetric() && (!microscope || (microscope->tilt.isZero(0) &&
                                                   (microscope->decenter.isZero(0) ||
                                                    !std::isfinite(microscope->pupil_distance))));
}

/// The z at which the microscope's plane of focus must meet its axis so that it holds the aerial
/// point; m.
double focus_through(const System& system, const Microscope& microscope,
                     const AerialPoint& aerial) {
  const Eigen::Vector3d axis = chief_ray_in_air(system, microscope, {0, 0}).direction;
  return aerial.focus + (aerial.m - microscope.decenter).dot(axis.head<2>()) / axis.z();
}

}  // namespace

void WideAngleSettings::check() const {
  if (microscope) microscope->check();
  detail::require(max_angle > 0 && max_angle < std::numbers::pi / 2,
                  "max_angle: must lie between 0 and 90 degrees");
  detail::require_positive(max_depth, "max_depth");
  detail::require_at_least(rings, 1, "rings");
  detail::require_at_least(arms, 2, "arms");
  const auto fits = [](int nodes) { return nodes >= 4 && nodes <= detail::Chebyshev2::kMaxNodes; };
  detail::require(fits(angle_nodes), "angle_nodes: must lie between 4 and 32");
  detail::require(fits(depth_nodes), "depth_nodes: must lie between 4 and 32");
}

/// The lens is the last two surfaces, so the gap that changes is the one before them.
System with_lens_distance(const System& system, double distance) {
  if (system.size() < 4) throw std::invalid_argument("surfaces: the system has no condensing lens");
  detail::require(std::isfinite(distance) && distance >= 0,
                  "lens_distance: must be finite and not negative");
  System moved = system;
  moved.surfaces[moved.surfaces.size() - 3].thickness = distance;
  return moved;
}

/// The table ends where bundles are vignetted or where its error exceeds kMaxTail, whichever is
/// nearer to the axis. Both ends are found by halving, in steps of a 160th of the angle, or of a
/// tenth where a table of two angles makes each try costly.
WideAngleMap::WideAngleMap(const System& system, const WideAngleSettings& settings)
    : settings_(settings),
      symmetric_(is_symmetric(system, settings.microscope)),
      tracer_(resolved(system, settings), first_pupil(resolved(system, settings), settings)),
      samples_(disc_samples(settings.rings, settings.arms)),
      coarse_(disc_samples(2, 12)),
      angle_nodes_(settings.angle_nodes),
      depth_nodes_(settings.depth_nodes),
      stop_z_(tracer_.system().vertex(stop_surface(system))),
      stop_radius_(system.stop ? system.stop->radius : std::numeric_limits<double>::infinity()) {
  const int parts = symmetric_ ? 160 : 10;  // of the angle, one at a time
  // where the nodes asked for are not enough
  constexpr int kManyAngles = 26;
  constexpr int kManyDepths = 18;
  const auto largest = [&](int most, auto&& fits) {  // part that fits, found by halving
    int good = parts / 10 - 1;
    int bad = most + 1;
    while (bad - good > 1) {
      const int middle = bad > most ? most : (good + bad) / 2;
      (fits(settings.max_angle * middle / parts) ? good : bad) = middle;
    }
    if (good < parts / 10)
      throw std::invalid_argument("max_angle: bundles are vignetted nearly everywhere");
    return good;
  };
  // First as far as bundles pass, then as far as the table is good enough.
  const int whole = largest(parts, [&](double angle) { return bundles_pass(angle); });
  if (build(settings.max_angle * whole / parts)) return;
  // The table was too coarse: more nodes, and if need be a smaller field.
  angle_nodes_ = std::max(angle_nodes_, kManyAngles);
  depth_nodes_ = std::max(depth_nodes_, kManyDepths);
  const int good = largest(whole, [&](double angle) { return build(angle); });
  // The last field that was tried need not be the one that is good.
  if (max_angle_ != settings.max_angle * good / parts) build(settings.max_angle * good / parts);
}

/// Whether whole bundles get through along the rim of the field: at three depths, and for a skew
/// map at all azimuths.
/// The rim alone is tested: inside it, bundles are less oblique and vignetted less.
bool WideAngleMap::bundles_pass(double angle) {
  constexpr int kDepths = 3;
  Spot spot;
  const int arms = symmetric_ ? 1 : detail::SkewTable::kArms;
  for (int i = 0; i < arms * kDepths; ++i) {
    const int arm = i / kDepths;
    const double azimuth = 2 * std::numbers::pi * arm / arms;
    const auto at = point_at_field(tracer_.system(), angle,
                                   settings_.max_depth * (i % kDepths) / (kDepths - 1));
    if (!at) return false;
    const Eigen::Vector3d point(at->x() * std::cos(azimuth), at->x() * std::sin(azimuth), at->z());
    if (!focus_bundle(point, tracer_, spot)) return false;
  }
  return true;
}

/// Best focus of one point's bundle. A microscope's pupil moves with its focus, so the focus f =
/// g(f) is found by the secant method, the first step a fixed-point step; a coarse bundle serves
/// until it is nearly found.
/// Nothing when a ray of the bundle is lost: a vignetted bundle focuses elsewhere, and the table
/// would have a kink there.
std::optional<AerialPoint> WideAngleMap::focus_bundle(const Eigen::Vector3d& point,
                                                      PupilTracer& tracer, Spot& spot) const {
  constexpr int kMaxFocusSteps = 20;
  // m, of the microscope's position; a tenth or less of it moves the image
  constexpr double kSettled = 1e-10;
  constexpr double kNearly = 1e-6;  // m
  const bool moves = settings_.microscope && std::isfinite(settings_.microscope->pupil_distance);
  Microscope microscope = settings_.microscope.value_or(Microscope{});
  double last_position = 0;
  double last_off = 0;
  bool coarse = moves;  // until the position is nearly found
  for (int step = 0; step < kMaxFocusSteps; ++step) {
    if (moves) tracer.set_pupil(Pupil::of_microscope(tracer.system(), microscope));
    if (!tracer.trace(point, coarse ? coarse_ : samples_, spot) || spot.lost > 0)
      return std::nullopt;
    const double focus = spot.moments().best_focus();
    if (!std::isfinite(focus)) return std::nullopt;
    const AerialPoint aerial{spot.chief_at(focus), focus};
    const double position = microscope.focus;
    const double off = focus_through(tracer.system(), microscope, aerial) - position;
    if (!coarse && (!moves || std::abs(off) < kSettled)) return aerial;
    // g depends weakly on f, so off has a slope near -1; a secant that says otherwise is made of
    // rounding.
    const double slope = step == 0 ? -1 : (off - last_off) / (position - last_position);
    microscope.focus = position - off / (std::isfinite(slope) && slope < -0.1 ? slope : -1);
    last_position = position;
    last_off = off;
    coarse = coarse && std::abs(off) > kNearly;
  }
  return std::nullopt;
}

/// False when a bundle is lost or the error is too large. The members then belong to no table,
/// until a later call succeeds.
bool WideAngleMap::build(double max_angle) {
  max_angle_ = max_angle;
  return measure_distances() && (symmetric_ ? build_flat() : build_skew());
}

/// Distances of the retina from the stop's center, as a polynomial in angle^2: even, as the eye is
/// rotationally symmetric whatever the viewing system.
bool WideAngleMap::measure_distances() {
  const int rows = angle_nodes_;
  Eigen::MatrixXd distance(rows, 1);
  for (int i = 0; i < rows; ++i) {
    const double angle = max_angle_ * std::sqrt((detail::Chebyshev2::node(i, rows) + 1) / 2);
    const auto on_retina = point_at_field(tracer_.system(), angle);
    if (!on_retina) return false;
    distance(i, 0) = (stop_z_ - on_retina->z()) / std::cos(angle);
  }
  distance_ = detail::Chebyshev2(distance);
  return true;
}

/// The polynomial in u = 2 (angle / max_angle)^2 - 1; it has no second variable.
double WideAngleMap::distance(double angle) const {
  const double part = angle / max_angle_;
  return distance_(2 * part * part - 1, 0).value;
}

/// Bundles at the Chebyshev nodes in (angle^2, depth). Heights are divided by the point's distance
/// from the axis, which leaves even functions without a zero on the axis.
/// No node lies on the axis, as Chebyshev's lie inside (-1, 1), so r is never 0.
bool WideAngleMap::trace_flat(Eigen::MatrixXd& focus, Eigen::MatrixXd& scale,
                              Eigen::MatrixXd& stop) {
  Spot spot;
  for (Eigen::Index i = 0; i < focus.rows(); ++i) {
    const double u = detail::Chebyshev2::node(static_cast<int>(i), angle_nodes_);
    const double angle = max_angle_ * std::sqrt((u + 1) / 2);
    for (Eigen::Index j = 0; j < focus.cols(); ++j) {
      const double v = detail::Chebyshev2::node(static_cast<int>(j), depth_nodes_);
      const double left = distance_(u, 0).value - settings_.max_depth * (v + 1) / 2;
      const double r = left * std::sin(angle);
      const auto aerial = focus_bundle({r, 0, stop_z_ - left * std::cos(angle)}, tracer_, spot);
      if (!aerial) return false;
      focus(i, j) = aerial->focus;
      scale(i, j) = aerial->m.x() / r;
      stop(i, j) = spot.chief_stop.x() / r;
    }
  }
  return true;
}

/// Symmetric map: interpolation, its error by the last coefficients, and cells for the inverse.
bool WideAngleMap::build_flat() {
  const int rows = angle_nodes_;
  const int columns = depth_nodes_;
  Eigen::MatrixXd focus(rows, columns);
  Eigen::MatrixXd scale(rows, columns);
  Eigen::MatrixXd stop(rows, columns);
  if (!trace_flat(focus, scale, stop)) return false;
  focus_ = detail::Chebyshev2(focus);
  scale_ = detail::Chebyshev2(scale);
  stop_ = detail::Chebyshev2(stop);
  // The scale's tail times the largest distance from the axis is a height.
  tail_ = std::max(focus_.tail(), scale_.tail() * stop_z_ * std::tan(max_angle_));
  if (!(tail_ < kMaxTail)) return false;
  // The image's sense, from a height near the axis, where the height itself would be 0.
  inverted_ = evaluate({max_angle_ / 100, 0}).height < 0 ? -1 : 1;
  const auto sampled = [&](const FlatSearch::Point& unit) {
    return sample({unit.x() * max_angle_, unit.y() * max_depth()});
  };
  flat_search_ = FlatSearch({32, 20}, sampled);
  const auto newton = [&](const FlatSearch::Point& image) {
    return [&, image](const FlatSearch::Point& start) { return solve(image, start); };
  };
  flat_search_.test_one_to_one(newton, sampled);
  return true;
}

/// Called by everything that speaks of a meridional plane.
void WideAngleMap::require_symmetry() const {
  if (!symmetric_)
    throw std::invalid_argument(
        "microscope: tilted or decentered, or the system has a surface off the axis or a toric "
        "one: "
        "its map has no meridional plane");
}

/// Polar coordinates about the stop's center: the field angle, and the distance of the retina less
/// the depth.
WideAngleMap::Plane WideAngleMap::plane_point(const FieldPosition& position) const {
  require_symmetry();
  const double left = distance(std::clamp(position.angle, 0.0, max_angle_)) - position.depth;
  return {left * std::sin(position.angle), stop_z_ - left * std::cos(position.angle)};
}

/// Inverse of plane_point: angle and distance at the stop's center.
/// kSlack, a length, becomes an angle by the distance; what lies within it is clamped onto the
/// edge.
std::optional<WideAngleMap::FieldPosition> WideAngleMap::position_of(const Plane& point) const {
  require_symmetry();
  if (!(point.z < stop_z_)) return std::nullopt;
  const double angle = std::atan2(point.r, stop_z_ - point.z);
  const double left = std::hypot(point.r, stop_z_ - point.z);
  if (!(angle <= max_angle_ + kSlack / left)) return std::nullopt;
  const double inside = std::clamp(angle, 0.0, max_angle_);
  const double depth = distance(inside) - left;
  if (!(depth >= -kSlack && depth <= max_depth() + kSlack)) return std::nullopt;
  return FieldPosition{inside, std::clamp(depth, 0.0, max_depth())};
}

/// Values and derivatives by the chain rule: u = 2 (angle / max_angle)^2 - 1, v = 2 depth /
/// max_depth - 1; height = scale * r with r = (distance - depth) sin(angle).
WideAngleMap::Meridional WideAngleMap::evaluate(const FieldPosition& position) const {
  const double part = position.angle / max_angle_;
  const double u = 2 * part * part - 1;
  const double v = 2 * position.depth / settings_.max_depth - 1;
  const double du = 4 * part / max_angle_;
  const double dv = 2 / settings_.max_depth;
  const auto focus = focus_(u, v);
  const auto scale = scale_(u, v);
  const auto distance = distance_(u, 0);
  const double sine = std::sin(position.angle);
  const double left = distance.value - position.depth;
  const double r = left * sine;
  const double r_per_angle = left * std::cos(position.angle) + distance.du * du * sine;
  Meridional made;
  made.focus = focus.value;
  made.height = scale.value * r;
  made.per_position << focus.du * du, focus.dv * dv, scale.du * du * r + scale.value * r_per_angle,
      scale.dv * dv * r - scale.value * sine;
  return made;
}

/// Whether the chief ray misses the eye's stop, which is open in the traced system.
/// The stop's table has the ratio of the chief ray's distance from the axis in the stop and in the
/// eye, which is even and without a zero on the axis.
bool WideAngleMap::in_shadow(const FieldPosition& position) const {
  if (!std::isfinite(stop_radius_) || !settings_.microscope) return false;
  const double part = position.angle / max_angle_;
  const double scale = stop_(2 * part * part - 1, 2 * position.depth / max_depth() - 1).value;
  return std::abs(scale * (distance(position.angle) - position.depth) * std::sin(position.angle)) >
         stop_radius_;
}

/// As the cell search wants it: the image, the determinant whose sign shows folds, and whether the
/// iris hides the position.
WideAngleMap::FlatSearch::Sample WideAngleMap::sample(const FieldPosition& position) const {
  const Meridional there = evaluate(position);
  return {{there.focus, there.height}, there.per_position.determinant(), in_shadow(position)};
}

/// Newton's method in (angle, depth), kept near the table. A solution outside it by less than
/// edge() is taken to lie on its boundary.
/// The start and the result are in the unit square of the cells, `image` in m. Nothing when it does
/// not converge, or ends outside.
std::optional<WideAngleMap::FlatSearch::Solution> WideAngleMap::solve(
    const FlatSearch::Point& image, const FlatSearch::Point& start) const {
  FieldPosition position{start.x() * max_angle_, start.y() * max_depth()};
  for (int step = 0; step < kMaxSteps; ++step) {
    const Meridional now = evaluate(position);
    const Eigen::Vector2d off(image.x() - now.focus, image.y() - now.height);
    if (off.norm() < kConverged) {
      const double aside = edge() / distance(0);
      const double along = edge();
      const bool inside = position.angle >= -aside && position.angle <= max_angle_ + aside &&
                          position.depth >= -along && position.depth <= max_depth() + along;
      if (!inside) return std::nullopt;
      position = {std::clamp(position.angle, 0.0, max_angle_),
                  std::clamp(position.depth, 0.0, max_depth())};
      const FlatSearch::Point unit(position.angle / max_angle_, position.depth / max_depth());
      return FlatSearch::Solution{unit, unit, sample(position)};
    }
    const Eigen::Vector2d move = now.per_position.inverse() * off;
    if (!move.allFinite()) return std::nullopt;
    position.angle =
        std::clamp(position.angle + move[0], -kStray * max_angle_, (1 + kStray) * max_angle_);
    position.depth =
        std::clamp(position.depth + move[1], -kStray * max_depth(), (1 + kStray) * max_depth());
  }
  return std::nullopt;
}

/// Where the table is not one-to-one, a value counts only when find() leads back to it.
/// So that at() and find() are inverse of each other wherever both answer.
std::optional<WideAngleMap::Meridional> WideAngleMap::at(const FieldPosition& position) const {
  require_symmetry();
  const double aside = kSlack / distance(0);
  if (!(position.angle >= 0 && position.angle <= max_angle_ + aside)) return std::nullopt;
  if (!(position.depth >= -kSlack && position.depth <= max_depth() + kSlack)) return std::nullopt;
  const FieldPosition inside{std::min(position.angle, max_angle_),
                             std::clamp(position.depth, 0.0, max_depth())};
  if (in_shadow(inside)) return std::nullopt;
  const Meridional made = evaluate(inside);
  if (!flat_search_.one_to_one() && !find(made.focus, made.height)) return std::nullopt;
  return made;
}

/// Inverse of at(). Near a fold the inverse of the Jacobian grows, and with it the table's error in
/// the eye; beyond kMaxRoundTrip there is no answer.
std::optional<WideAngleMap::FieldPosition> WideAngleMap::find(double focus, double height) const {
  require_symmetry();
  const FlatSearch::Point image(focus, height);
  const auto found =
      flat_search_.only(image, [&](const FlatSearch::Point& start) { return solve(image, start); });
  if (!found) return std::nullopt;
  const FieldPosition position{found->unit.x() * max_angle_, found->unit.y() * max_depth()};
  Eigen::Matrix2d per_meter = evaluate(position).per_position;
  // An angle becomes a length across.
  per_meter.col(0) /= distance(position.angle);
  if (!(2 * tail_ * per_meter.inverse().norm() < kMaxRoundTrip)) return std::nullopt;
  return position;
}

/// Rotational symmetry: the azimuth is kept, the height takes the sign of the magnification (thesis
/// 5.2, (5.10), (5.11) with phi + pi for an inverted image).
std::optional<AerialPoint> WideAngleMap::image(const Eigen::Vector3d& point) const {
  if (!tracer_.in_vitreous(point)) return std::nullopt;
  if (!symmetric_) return skew_image(point);
  const double r = point.head<2>().norm();
  const auto position = position_of({r, point.z()});
  const auto there = position ? at(*position) : std::nullopt;
  if (!there) return std::nullopt;
  AerialPoint aerial;
  aerial.focus = there->focus;
  if (r > 0) aerial.m = point.head<2>() * (there->height / r);
  return aerial;
}

/// Thesis 4.1: the position from d_ls and d_op, through the table instead of the fitted curves.
/// The azimuth of m is the point's, turned by pi where the image is inverted.
std::optional<Eigen::Vector3d> WideAngleMap::point(const AerialPoint& aerial) const {
  if (!(std::isfinite(aerial.focus) && aerial.m.allFinite())) return std::nullopt;
  if (!symmetric_) {
    const SkewSearch::Point image(aerial.m.x(), aerial.m.y(), aerial.focus);
    const auto found = skew_search_.only(
        image, [&](const SkewSearch::Point& start) { return solve(image, start); });
    return found ? std::optional(skew_point(found->position)) : std::nullopt;
  }
  const double height = aerial.m.norm();
  const auto position = find(aerial.focus, inverted_ * height);
  if (!position) return std::nullopt;
  const Plane at = plane_point(*position);
  if (height == 0) return Eigen::Vector3d(0, 0, at.z);
  const Eigen::Vector2d across = aerial.m * (inverted_ * at.r / height);
  return Eigen::Vector3d(across.x(), across.y(), at.z);
}

/// Nothing is inverted here, so folds and the table's edges do not count.
std::optional<AerialPoint> WideAngleMap::traced_image(const Eigen::Vector3d& point) const {
  PupilTracer tracer = tracer_;  // a focusing microscope moves its pupil
  Spot spot;
  auto aerial = focus_bundle(point, tracer, spot);
  if (settings_.microscope && aerial && spot.chief_stop.norm() > stop_radius_) return std::nullopt;
  return aerial;
}

}  // namespace vitreo::optics
