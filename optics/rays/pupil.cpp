// SPDX-License-Identifier: Apache-2.0
#include "optics/rays/pupil.h"

#include "optics/numerics/preconditions.h"
#include "optics/system/frames.h"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>

namespace vitreo::optics {
namespace {

/// A block is always traced whole, so loops run over all lanes and the vectorizer needs no
/// remainder.
constexpr int kLanes = RayBlock::kSize;

/// The same system with its stop opened, for aiming: its surface is still marked, but nothing is
/// clipped.
System opened(System system) {
  constexpr double kWide = 1;  // m
  if (system.stop) system.stop->radius = kWide;
  return system;
}

/// dx/dz, dy/dz.
Eigen::Vector2d slope_of(const Eigen::Vector3d& direction) {
  return direction.head<2>() / direction.z();
}

/// Where the rays, straight on, meet the x-y plane of a frame, in its coordinates.
void reach_plane(const RayBlock& rays, const SurfaceFrame& frame, double* x, double* y) {
  for (int i = 0; i < kLanes; ++i) {
    const Eigen::Vector3d from = frame.to_local({rays.x[i], rays.y[i], rays.z[i]});
    const Eigen::Vector3d along =
        frame.axes.transpose() * Eigen::Vector3d(rays.dx[i], rays.dy[i], rays.dz[i]);
    const Eigen::Vector3d at = from - along * (from.z() / along.z());
    const bool alive = rays.lost[i] == 0;
    x[i] = alive ? at.x() : std::numeric_limits<double>::quiet_NaN();
    y[i] = alive ? at.y() : std::numeric_limits<double>::quiet_NaN();
  }
}

}  // namespace

/// Cells of equal area, so that plain means over the samples are means over the disc.
std::vector<Eigen::Vector2d> disc_samples(int rings, int arms) {
  detail::require_at_least(rings, 1, "rings");
  detail::require_at_least(arms, 1, "arms");
  std::vector<Eigen::Vector2d> samples;
  for (int i = 0; i < rings; ++i) {
    const double radius = std::sqrt((i + 0.5) / rings);
    for (int j = 0; j < arms; ++j) {
      const double angle = 2 * std::numbers::pi * j / arms;
      samples.emplace_back(radius * std::cos(angle), radius * std::sin(angle));
    }
  }
  return samples;
}

/// Rim to rim. The ends weigh as much as all others, which shifts a fan's best focus a little
/// against a disc's.
std::vector<Eigen::Vector2d> fan_samples(int count) {
  detail::require_at_least(count, 2, "count");
  std::vector<Eigen::Vector2d> samples;
  samples.reserve(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) samples.emplace_back(2.0 * i / (count - 1) - 1, 0);
  return samples;
}

/// The disc lies in the vertex plane of the stop's surface, tilted with it.
Pupil Pupil::of_stop(const System& system, Kind kind) {
  if (!system.stop) throw std::invalid_argument("stop: the system has none");
  const int surface = system.stop->surface;
  const bool graded = !system.surfaces[surface - 2].gradient.is_none();
  Pupil made{graded ? Kind::real_stop : kind,
             system.vertex(surface),
             {0, 0},
             system.stop->radius,
             std::nullopt};
  if (!system.surfaces[surface - 1].placement.is_none())
    made.frame = surface_frame(system, surface);
  return made;
}

/// sin u = NA in air, so the aperture's slope is tan(asin(NA)); a pupil at a distance has that
/// times the distance as its radius.
Pupil Pupil::of_microscope(const System& system, const Microscope& microscope) {
  microscope.check();
  const double opening = std::tan(std::asin(microscope.numerical_aperture));
  const Ray axis = chief_ray_in_air(system, microscope, {0, 0});
  if (!std::isfinite(microscope.pupil_distance))
    return {Kind::infinity, 0, slope_of(axis.direction), opening, std::nullopt};
  const Eigen::Vector3d center = axis.origin + microscope.pupil_distance * axis.direction;
  return {Kind::plane, center.z(), center.head<2>(), std::abs(microscope.pupil_distance) * opening,
          std::nullopt};
}

/// Bisection for the crossing of the line with the retina: z - sag(r) along it.
/// Sixty halvings of the distance from retina to stop end at rounding; Newton's method would need a
/// retina without an edge.
std::optional<Eigen::Vector3d> point_at_field(const System& system, double angle, double depth) {
  constexpr int kHalvings = 60;
  if (!std::isfinite(angle) || std::abs(angle) >= std::numbers::pi / 2) {
    throw std::invalid_argument("angle: must lie between -90 and 90 degrees");
  }
  detail::require_finite(depth, "depth");
  if (!system.stop) throw std::invalid_argument("stop: the system has none");
  const double pupil = system.vertex(system.stop->surface);
  // the line is behind the retina at low, before it at high
  double low = 0;
  double high = pupil;
  for (int i = 0; i < kHalvings; ++i) {
    const double z = (low + high) / 2;
    // NaN: beyond the retina's edge
    (z > system.surfaces.front().sag((pupil - z) * std::tan(angle)) ? high : low) = z;
  }
  // m; where the retina ends short of the line, the halving meets its edge
  constexpr double kOnRetina = 1e-9;
  const double gap = high - system.surfaces.front().sag((pupil - high) * std::tan(angle));
  const double z = low + depth * std::cos(angle);
  if (!(gap < kOnRetina && z < pupil)) return std::nullopt;
  return Eigen::Vector3d((pupil - z) * std::tan(angle), 0, z);
}

/// Two tracers of one system: the real one clips, the open one carries rays that are still being
/// aimed through any stop.
PupilTracer::PupilTracer(const System& system, const Pupil& pupil, CpuLevel level)
    : system_(system),
      pupil_(pupil),
      real_(system, level),
      open_(opened(system), level),
      last_vertex_(system.vertex(system.size())) {
  if (fills_stop() && !system.stop) throw std::invalid_argument("stop: the system has none");
  detail::require(std::isfinite(pupil.radius) && pupil.radius > 0,
                  "pupil: needs a positive radius");
}

/// By the heights of retina and surface 2 over the point's distance from the axis.
/// A point on the retina is in the vitreous, and so is one that touches the lens.
bool PupilTracer::in_vitreous(const Eigen::Vector3d& point) const {
  constexpr double kRounding = 1e-9;  // m: a point computed to lie on the retina is on it
  if (!point.allFinite()) return false;
  const double r = point.head<2>().norm();
  const double lens = surface_height(system_, 2, point.head<2>());
  return point.z() >= system_.surfaces[0].sag(r) - kRounding &&
         point.z() <= (std::isnan(lens) ? system_.vertex(2) : lens);  // NaN: it ends before
}

/// All lanes from one point, by their slopes dx/dz and dy/dz: unlike angles, these are the two
/// unknowns of aiming without a singular direction.
void PupilTracer::fill(const Eigen::Vector3d& point, RayBlock& rays, const double* slope_x,
                       const double* slope_y) const {
  for (int i = 0; i < kLanes; ++i) {
    const double scale = 1 / std::sqrt(1 + slope_x[i] * slope_x[i] + slope_y[i] * slope_y[i]);
    rays.x[i] = point.x();
    rays.y[i] = point.y();
    rays.z[i] = point.z();
    rays.dx[i] = slope_x[i] * scale;
    rays.dy[i] = slope_y[i] * scale;
    rays.dz[i] = scale;
    rays.lost[i] = rays.stop_x[i] = rays.stop_y[i] = 0;
  }
}

/// Traces as far as needed and gives the coordinates at which the pupil is met; NaN where a ray is
/// lost before. For a pupil at infinity the coordinates are the slopes.
/// The lanes are traced in place, so `rays` is used up.
void PupilTracer::reach(RayBlock& rays, double* pupil_x, double* pupil_y) const {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  if (pupil_.kind == Pupil::Kind::stop) {
    open_.trace_before_stop(rays);
  } else if (pupil_.kind == Pupil::Kind::real_stop) {
    open_.trace_through_stop(rays);
  } else {
    open_.trace_out(rays);
  }
  if (pupil_.kind == Pupil::Kind::stop && pupil_.frame)
    return reach_plane(rays, *pupil_.frame, pupil_x, pupil_y);
  for (int i = 0; i < kLanes; ++i) {
    const double slope_x = rays.dx[i] / rays.dz[i];
    const double slope_y = rays.dy[i] / rays.dz[i];
    const double far = pupil_.z - rays.z[i];
    double x = rays.x[i] + far * slope_x;
    double y = rays.y[i] + far * slope_y;
    if (pupil_.kind == Pupil::Kind::real_stop) x = rays.stop_x[i], y = rays.stop_y[i];
    if (pupil_.kind == Pupil::Kind::infinity) x = slope_x, y = slope_y;
    pupil_x[i] = rays.lost[i] == 0 ? x : kNan;
    pupil_y[i] = rays.lost[i] == 0 ? y : kNan;
  }
}

/// Ray aiming: Newton's method for the slopes (dx/dz, dy/dz) in the vitreous that meet `target` in
/// the pupil. The Jacobian is by forward differences: the first three lanes of a block are the ray
/// and its two neighbors, so a step costs one block. A step that loses the ray, or doubles the
/// miss, is halved.
std::optional<PupilTracer::Aim> PupilTracer::solve(const Eigen::Vector3d& point,
                                                   const Eigen::Vector2d& target) const {
  constexpr double kStep = 1e-6;        // of slope: the Jacobian good to 1e-5
  constexpr double kConverged = 1e-13;  // m or slope
  constexpr int kMaxSteps = 30;
  const double towards = system_.stop ? system_.vertex(system_.stop->surface) : system_.vertex(2);
  // Start: the straight line to the axis in the plane of the stop, refraction ignored.
  Eigen::Vector2d slope = -point.head<2>() / std::max(towards - point.z(), 1e-3);
  Eigen::Vector2d last_step(0, 0);
  RayBlock rays;
  double slope_x[kLanes];
  double slope_y[kLanes];
  double x[kLanes];
  double y[kLanes];
  double last = std::numeric_limits<double>::infinity();
  for (int step = 0; step < kMaxSteps; ++step) {
    std::fill_n(slope_x, kLanes, slope.x());
    std::fill_n(slope_y, kLanes, slope.y());
    slope_x[1] += kStep;
    slope_y[2] += kStep;
    fill(point, rays, slope_x, slope_y);
    reach(rays, x, y);
    const Eigen::Vector2d off(target.x() - x[0], target.y() - y[0]);
    Eigen::Matrix2d jacobian;
    jacobian << x[1] - x[0], x[2] - x[0], y[1] - y[0], y[2] - y[0];
    jacobian /= kStep;
    if (!(off.allFinite() && jacobian.allFinite() && jacobian.determinant() != 0) ||
        off.norm() > 2 * last) {
      if (step == 0 || last_step.norm() < kConverged) return std::nullopt;
      last_step /= 2;  // too far: the ray was lost, or missed by more than before
      slope -= last_step;
      continue;
    }
    const Eigen::Matrix2d inverse = jacobian.inverse();
    // Rounding ends it too: nearer than 1e-11 and not getting nearer.
    if (off.norm() < kConverged || (off.norm() < 1e-11 && off.norm() >= last))
      return Aim{slope, inverse};
    last = off.norm();
    last_step = inverse * off;
    slope += last_step;
  }
  return std::nullopt;
}

/// The other rays of the bundle from the chief ray's Jacobian, by the chord method (Newton with a
/// constant Jacobian): what is left of a target moves a sample within the pupil, by less than a
/// micrometer, and is no error of any ray.
/// The inverse Jacobian is that of the chief ray. A lane that is lost keeps its slope and is lost
/// again when it is traced in earnest.
void PupilTracer::refine(const Eigen::Vector3d& point, const Aim& aim, const double* target_x,
                         const double* target_y, double* slope_x, double* slope_y) const {
  const int steps = fills_stop() ? 5 : 2;  // a microscope's pupil is small
  const Eigen::Matrix2d& inverse = aim.slope_from_pupil;
  RayBlock rays;
  double x[kLanes];
  double y[kLanes];
  for (int i = 0; i < kLanes; ++i) {
    const double ox = target_x[i] - pupil_.center.x();
    const double oy = target_y[i] - pupil_.center.y();
    slope_x[i] = aim.slope.x() + inverse(0, 0) * ox + inverse(0, 1) * oy;
    slope_y[i] = aim.slope.y() + inverse(1, 0) * ox + inverse(1, 1) * oy;
  }
  for (int step = 0; step < steps; ++step) {
    fill(point, rays, slope_x, slope_y);
    reach(rays, x, y);
    for (int i = 0; i < kLanes; ++i) {
      const double ox = target_x[i] - x[i];
      const double oy = target_y[i] - y[i];
      if (!(std::isfinite(ox) && std::isfinite(oy))) continue;
      slope_x[i] += inverse(0, 0) * ox + inverse(0, 1) * oy;
      slope_y[i] += inverse(1, 0) * ox + inverse(1, 1) * oy;
    }
  }
}

/// By Newton's method of its own, exact to rounding, where a bundle's rays stop after a few chord
/// steps.
std::optional<Ray> PupilTracer::aim(const Eigen::Vector3d& point,
                                    const Eigen::Vector2d& sample) const {
  if (!in_vitreous(point)) return std::nullopt;
  const auto found = solve(point, pupil_.center + pupil_.radius * sample);
  if (!found) return std::nullopt;
  return Ray{point, Eigen::Vector3d(found->slope.x(), found->slope.y(), 1).normalized()};
}

/// Behind the system in coordinates of the last vertex plane: a position and a slope describe the
/// ray at every distance.
/// Only the first `count` lanes; the others are repetitions.
void PupilTracer::add(const RayBlock& rays, int count, Spot& spot) const {
  for (int i = 0; i < count; ++i) {
    if (rays.lost[i] != 0) {
      ++spot.lost;
      continue;
    }
    const Eigen::Vector2d slope(rays.dx[i] / rays.dz[i], rays.dy[i] / rays.dz[i]);
    spot.position.push_back(Eigen::Vector2d(rays.x[i], rays.y[i]) +
                            (last_vertex_ - rays.z[i]) * slope);
    spot.slope.push_back(slope);
  }
}

/// The chief ray alone first, since it decides whether there is an image and gives the Jacobian for
/// the others.
/// Lost rays count in spot.lost and have no position. A microscope's bundle goes through the real
/// system, so the eye's stop may cut it. Spare lanes of the last block repeat its first sample and
/// are left out.
bool PupilTracer::trace(const Eigen::Vector3d& point, const std::vector<Eigen::Vector2d>& samples,
                        Spot& spot) const {
  spot.position.clear();
  spot.slope.clear();
  spot.lost = 0;
  if (!in_vitreous(point)) return false;
  const auto chief = solve(point, pupil_.center);
  if (!chief) return false;
  // The stop itself is what is filled: rounding at its rim is no vignetting.
  const BatchTracer& tracer = fills_stop() ? open_ : real_;
  RayBlock rays;
  double target_x[kLanes];
  double target_y[kLanes];
  double slope_x[kLanes];
  double slope_y[kLanes];
  std::fill_n(slope_x, kLanes, chief->slope.x());
  std::fill_n(slope_y, kLanes, chief->slope.y());
  fill(point, rays, slope_x, slope_y);
  tracer.trace_out(rays);
  add(rays, 1, spot);
  if (spot.lost > 0) return false;
  spot.chief = spot.position[0];
  spot.chief_slope = spot.slope[0];
  spot.chief_stop = {rays.stop_x[0], rays.stop_y[0]};
  spot.position.clear();
  spot.slope.clear();
  for (std::size_t first = 0; first < samples.size(); first += kLanes) {
    const int count = static_cast<int>(std::min<std::size_t>(kLanes, samples.size() - first));
    for (int i = 0; i < kLanes; ++i) {
      const Eigen::Vector2d target =
          pupil_.center + pupil_.radius * samples[first + (i < count ? i : 0)];
      target_x[i] = target.x();
      target_y[i] = target.y();
    }
    refine(point, *chief, target_x, target_y, slope_x, slope_y);
    fill(point, rays, slope_x, slope_y);
    tracer.trace_out(rays);
    add(rays, count, spot);
  }
  return true;
}

}  // namespace vitreo::optics
