// SPDX-License-Identifier: Apache-2.0
#include "optics/wide_angle_map.h"

#include <Eigen/Dense>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

namespace vitreo::optics {
namespace {

constexpr double kSlack = 1e-9;  // of the table's sides: a point computed to lie on its edge is in it

/// With its lens in place. For a microscope the stop lets everything through, so that the table reaches past the iris'
/// shadow, whose edge is no smooth curve in it; the shadow is told from the chief ray.
System resolved(const System& system, const WideAngleSettings& settings) {
  constexpr double kWide = 1;  // m
  settings.check();
  system.check();
  if (!system.stop) throw std::invalid_argument("stop: the system has none");
  System made = settings.lens_distance ? with_lens_distance(system, *settings.lens_distance) : system;
  if (settings.microscope) made.stop->radius = kWide;
  return made;
}

Pupil first_pupil(const System& system, const WideAngleSettings& settings) {
  return settings.microscope ? Pupil::of_microscope(system, *settings.microscope) : Pupil::of_stop(system);
}

}  // namespace

void WideAngleSettings::check() const {
  const auto positive = [](double x) { return std::isfinite(x) && x > 0; };
  if (microscope) {
    microscope->check();
    if (!(microscope->decentre.isZero(0) && microscope->tilt.isZero(0))) {
      throw std::invalid_argument("microscope: a map needs it centred; ExactProjection takes any");
    }
  }
  if (!(positive(max_angle) && max_angle < std::numbers::pi / 2)) {
    throw std::invalid_argument("max_angle: must lie between 0 and 90 degrees");
  }
  if (!positive(max_depth)) throw std::invalid_argument("max_depth: must be positive");
  if (rings < 1) throw std::invalid_argument("rings: must be at least 1");
  if (arms < 2) throw std::invalid_argument("arms: must be at least 2");
  const auto fits = [](int nodes) { return nodes >= 4 && nodes <= detail::Chebyshev2::kMaxNodes; };
  if (!fits(angle_nodes)) throw std::invalid_argument("angle_nodes: must lie between 4 and 32");
  if (!fits(depth_nodes)) throw std::invalid_argument("depth_nodes: must lie between 4 and 32");
}

System with_lens_distance(const System& system, double distance) {
  if (system.size() < 4) throw std::invalid_argument("surfaces: the system has no condensing lens");
  if (!(std::isfinite(distance) && distance >= 0)) {
    throw std::invalid_argument("lens_distance: must be finite and not negative");
  }
  System moved = system;
  moved.surfaces[moved.surfaces.size() - 3].thickness = distance;
  return moved;
}

WideAngleMap::WideAngleMap(const System& system, const WideAngleSettings& settings)
    : settings_(settings),
      tracer_(resolved(system, settings), first_pupil(resolved(system, settings), settings)),
      samples_(disc_samples(settings.rings, settings.arms)),
      stop_z_(Pupil::of_stop(system).z),
      stop_radius_(system.stop->radius) {
  constexpr int kTenths = 40;  // a fortieth of the angle at a time
  for (int part = kTenths; part >= kTenths / 10; --part) {
    if (build(settings.max_angle * part / kTenths)) return;
  }
  throw std::invalid_argument("max_angle: bundles are vignetted nearly everywhere");
}

std::optional<AerialPoint> WideAngleMap::focus_bundle(const Eigen::Vector3d& point, PupilTracer& tracer,
                                                      Spot& spot) const {
  constexpr int kMaxSteps = 20;
  constexpr double kSettled = 1e-11;  // m
  const bool moves = settings_.microscope && std::isfinite(settings_.microscope->pupil_distance);
  Microscope microscope = settings_.microscope.value_or(Microscope{});
  for (int step = 0; step < kMaxSteps; ++step) {
    if (moves) tracer.set_pupil(Pupil::of_microscope(tracer.system(), microscope));
    if (!tracer.trace(point, samples_, spot) || spot.lost > 0) return std::nullopt;
    const double focus = spot.moments().best_focus();
    if (!std::isfinite(focus)) return std::nullopt;
    if (!moves || std::abs(focus - microscope.focus) < kSettled) return AerialPoint{spot.chief_at(focus), focus};
    microscope.focus = focus;
  }
  return std::nullopt;
}

bool WideAngleMap::build(double max_angle) {
  constexpr double kMaxTail = 2e-6;  // m
  const int rows = settings_.angle_nodes, columns = settings_.depth_nodes;
  Eigen::MatrixXd focus(rows, columns), scale(rows, columns), stop(rows, columns), distance(rows, 1);
  Spot spot;
  max_angle_ = max_angle;
  for (int i = 0; i < rows; ++i) {
    const double angle = max_angle * std::sqrt((detail::Chebyshev2::node(i, rows) + 1) / 2);
    const auto on_retina = point_at_field(tracer_.system(), angle);
    if (!on_retina) return false;
    distance(i, 0) = (stop_z_ - on_retina->z()) / std::cos(angle);
    for (int j = 0; j < columns; ++j) {
      const double left = distance(i, 0) - settings_.max_depth * (detail::Chebyshev2::node(j, columns) + 1) / 2;
      const double r = left * std::sin(angle);
      const auto aerial = focus_bundle({r, 0, stop_z_ - left * std::cos(angle)}, tracer_, spot);
      if (!aerial) return false;
      focus(i, j) = aerial->focus;
      scale(i, j) = aerial->m.x() / r;
      stop(i, j) = spot.chief_stop.x() / r;
    }
  }
  focus_ = detail::Chebyshev2(focus);
  scale_ = detail::Chebyshev2(scale);
  stop_ = detail::Chebyshev2(stop);
  distance_ = detail::Chebyshev2(distance);
  tail_ = std::max(focus_.tail(), scale_.tail() * stop_z_ * std::tan(max_angle));
  plant_seeds();
  return tail_ < kMaxTail;
}

void WideAngleMap::plant_seeds() {
  constexpr int kSeeds = 8;
  orientation_ = evaluate({max_angle_ / 100, max_depth() / 2}).per_place.determinant() > 0 ? 1 : -1;
  seeds_.clear();
  for (int i = 0; i < kSeeds * kSeeds; ++i) {
    const Place place{max_angle_ * (i % kSeeds + 0.5) / kSeeds, max_depth() * (i / kSeeds + 0.5) / kSeeds};
    const Meridional there = evaluate(place);
    if (there.per_place.determinant() * orientation_ > 0) seeds_.push_back({there.focus, there.height, place});
  }
}

WideAngleMap::Plane WideAngleMap::plane_point(const Place& place) const {
  const double part = place.angle / max_angle_;
  const double left = distance_(std::clamp(2 * part * part - 1, -1.0, 1.0), 0).value - place.depth;
  return {left * std::sin(place.angle), stop_z_ - left * std::cos(place.angle)};
}

std::optional<WideAngleMap::Place> WideAngleMap::place_of(const Plane& point) const {
  if (!(point.z < stop_z_)) return std::nullopt;
  const double angle = std::atan2(point.r, stop_z_ - point.z);
  if (angle > max_angle_ * (1 + kSlack)) return std::nullopt;
  const Plane retina = plane_point({angle, 0});
  const double depth = (point.z - retina.z) / std::cos(angle);
  if (!(depth >= -kSlack * settings_.max_depth && depth <= settings_.max_depth * (1 + kSlack))) return std::nullopt;
  return Place{angle, depth};
}

WideAngleMap::Meridional WideAngleMap::evaluate(const Place& place) const {
  const double part = place.angle / max_angle_;
  const double u = std::clamp(2 * part * part - 1, -1.0, 1.0);
  const double v = std::clamp(2 * place.depth / settings_.max_depth - 1, -1.0, 1.0);
  const double du = 4 * part / max_angle_, dv = 2 / settings_.max_depth;
  const auto focus = focus_(u, v), scale = scale_(u, v);
  const auto distance = distance_(u, 0);
  const double sine = std::sin(place.angle), left = distance.value - place.depth;
  const double r = left * sine, r_per_angle = left * std::cos(place.angle) + distance.du * du * sine;
  Meridional made;
  made.focus = focus.value;
  made.height = scale.value * r;
  made.per_place << focus.du * du, focus.dv * dv, scale.du * du * r + scale.value * r_per_angle,
      scale.dv * dv * r - scale.value * sine;
  return made;
}

bool WideAngleMap::in_shadow(const Place& place) const {
  if (!settings_.microscope) return false;
  const double part = place.angle / max_angle_;
  const double u = std::clamp(2 * part * part - 1, -1.0, 1.0);
  const double v = std::clamp(2 * place.depth / max_depth() - 1, -1.0, 1.0);
  return std::abs(stop_(u, v).value) * plane_point(place).r > stop_radius_;
}

std::optional<WideAngleMap::Meridional> WideAngleMap::at(const Place& place) const {
  if (!(place.angle >= 0 && place.angle <= max_angle_ * (1 + kSlack))) return std::nullopt;
  if (!(place.depth >= -kSlack * max_depth() && place.depth <= max_depth() * (1 + kSlack))) return std::nullopt;
  const Meridional made = evaluate(place);
  if (!(made.per_place.determinant() * orientation_ > 0) || in_shadow(place)) return std::nullopt;
  return made;
}

std::optional<WideAngleMap::Place> WideAngleMap::newton(double focus, double height, Place start) const {
  constexpr int kMaxSteps = 30;
  constexpr double kConverged = 1e-12;  // m
  Place place = start;
  for (int step = 0; step < kMaxSteps; ++step) {
    const Meridional now = evaluate(place);
    const Eigen::Vector2d off(focus - now.focus, height - now.height);
    if (off.norm() < kConverged) {
      return now.per_place.determinant() * orientation_ > 0 ? std::optional(place) : std::nullopt;
    }
    const Eigen::Vector2d move = now.per_place.inverse() * off;
    if (!move.allFinite()) return std::nullopt;
    place.angle = std::clamp(place.angle + move[0], 0.0, max_angle_);
    place.depth = std::clamp(place.depth + move[1], 0.0, max_depth());
  }
  return std::nullopt;
}

std::optional<WideAngleMap::Place> WideAngleMap::find(double focus, double height) const {
  constexpr int kTries = 4;
  std::array<std::pair<double, std::size_t>, 64> nearest;
  for (std::size_t i = 0; i < seeds_.size(); ++i) {
    nearest[i] = {std::hypot(seeds_[i].focus - focus, seeds_[i].height - height), i};
  }
  const std::size_t tries = std::min<std::size_t>(kTries, seeds_.size());
  std::partial_sort(nearest.begin(), nearest.begin() + tries, nearest.begin() + seeds_.size());
  for (std::size_t i = 0; i < tries; ++i) {
    const auto found = newton(focus, height, seeds_[nearest[i].second].place);
    if (found) return in_shadow(*found) ? std::nullopt : found;
  }
  return std::nullopt;
}

std::optional<AerialPoint> WideAngleMap::image(const Eigen::Vector3d& point) const {
  if (!tracer_.in_vitreous(point)) return std::nullopt;
  const double r = point.head<2>().norm();
  const auto place = place_of({r, point.z()});
  const auto there = place ? at(*place) : std::nullopt;
  if (!there) return std::nullopt;
  AerialPoint aerial;
  aerial.focus = there->focus;
  if (r > 0) aerial.m = point.head<2>() * (there->height / r);
  return aerial;
}

std::optional<Eigen::Vector3d> WideAngleMap::point(const AerialPoint& aerial) const {
  if (!(std::isfinite(aerial.focus) && aerial.m.allFinite())) return std::nullopt;
  const double inverted = evaluate({max_angle_ / 100, 0}).height < 0 ? -1 : 1;
  const double height = aerial.m.norm();
  const auto place = find(aerial.focus, inverted * height);
  if (!place) return std::nullopt;
  const Plane at = plane_point(*place);
  if (height == 0) return Eigen::Vector3d(0, 0, at.z);
  const Eigen::Vector2d across = aerial.m * (inverted * at.r / height);
  return Eigen::Vector3d(across.x(), across.y(), at.z);
}

std::optional<AerialPoint> WideAngleMap::traced_image(const Eigen::Vector3d& point) const {
  PupilTracer tracer = tracer_;  // a focusing microscope moves its pupil
  Spot spot;
  const auto aerial = focus_bundle(point, tracer, spot);
  if (settings_.microscope && aerial && spot.chief_stop.norm() > stop_radius_) return std::nullopt;
  return aerial;
}

}  // namespace vitreo::optics
