// SPDX-License-Identifier: Apache-2.0
#include "optics/analysis/viewing.h"

#include "optics/numerics/preconditions.h"
#include "optics/rays/trace.h"
#include "optics/system/first_order.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

namespace vitreo::optics {
namespace {

/// Throws std::invalid_argument for an unsound system and for one without a stop: all quantities
/// here are of a stop.
const Stop& stop_of(const System& system) {
  system.check();
  system.require_centered();
  if (!system.stop) throw std::invalid_argument("stop: the system has none");
  return *system.stop;
}

/// In first order. A relaxed emmetropic eye alone images its retina nearly to infinity, but not
/// quite: of table 3.1 the virtual image lies 3.9 m behind the cornea.
AxialImage retina_image(const System& system) {
  const auto image = axial_image(system, 0);
  if (!image) throw std::invalid_argument("system: the image of the retina is at infinity");
  return *image;
}

/// n sin(u') of the traced ray from the retina's vertex through surface 2's vertex plane at
/// `radius`; 0 when it is lost.
double traced_image_aperture(System system, double radius) {
  const double distance = system.surfaces.front().thickness;
  system.stop.reset();  // this beam is defined by surface 2; elsewhere it is wider than the stop
  const Ray ray{Eigen::Vector3d::Zero(), Eigen::Vector3d(radius, 0, distance).normalized()};
  const TraceResult traced = trace_out(system, ray);
  if (traced.status != TraceStatus::ok) return 0;
  return system.surfaces.back().index * traced.ray.direction.head<2>().norm();
}

/// The system before the stop's surface, and that from it on; both keep the eye frame.
System before_stop(const System& system, int stop) {
  System part;
  part.surfaces.assign(system.surfaces.begin(), system.surfaces.begin() + stop - 1);
  return part;
}
/// Surface 1 is a stand-in for the retina: it refracts nothing, and its thickness puts the stop's
/// surface back to its own z.
System from_stop(const System& system, int stop) {
  System part;
  part.surfaces.assign(system.surfaces.begin() + stop - 2, system.surfaces.end());
  part.surfaces.front() = Surface{};
  part.surfaces.front().thickness = system.vertex(stop);
  part.surfaces.front().index = system.surfaces[stop - 2].index;
  return part;
}

/// Intersection of a ray in the vitreous, going towards -z, with the retina: the secant slope over
/// 0.1 um in Newton's method, from the vertex plane, so that it also serves aspheres. Nothing when
/// it does not converge.
std::optional<Eigen::Vector3d> on_retina(const Surface& retina, const Ray& ray) {
  constexpr int kSteps = 50;
  constexpr double kConverged = 1e-12;  // m
  double s = -ray.origin.z() / ray.direction.z();
  double step = 1e-3;
  for (int i = 0; i < kSteps; ++i) {
    const auto gap = [&](double at) {
      const Eigen::Vector3d p = ray.origin + at * ray.direction;
      return p.z() - retina.sag(p.head<2>().norm());
    };
    if (std::isnan(gap(s))) {  // beyond the equator: shorten the step
      s *= 0.95;
      continue;
    }
    constexpr double kProbe = 1e-7;
    step = gap(s) * kProbe / (gap(s + kProbe) - gap(s));
    if (!std::isfinite(step)) return std::nullopt;
    s -= step;
    if (std::abs(step) < kConverged) return ray.origin + s * ray.direction;
  }
  return std::nullopt;
}

/// Heights on the surfaces that a ray meets, by tracing through 2, 3, ... surfaces. Few rays, so
/// the repetition is cheap; the trace itself keeps no path.
/// Heights are signed, m. The surface at which the ray is lost gets none, so their number tells how
/// far it came.
TraceResult follow_out(const System& part, const Ray& ray, std::vector<double>& heights) {
  TraceResult traced{ray, TraceStatus::ok, 0};
  for (int count = 2; count <= part.size(); ++count) {
    System head = part;
    head.surfaces.resize(static_cast<std::size_t>(count));
    traced = trace_out(head, ray);
    if (traced.status != TraceStatus::ok) break;
    heights.push_back(traced.ray.origin.x());
  }
  return traced;
}

/// Whether the chief ray under `angle` (rad) leaves the system and stays within `clear_radius` (m)
/// behind `from_surface`. heights[0] is the retina's, so the index from_surface is that of the next
/// surface.
bool passes(const System& system, double angle, int from_surface, double clear_radius,
            ChiefRay& ray) {
  ray = chief_ray_at_stop(system, angle);
  if (!ray.complete) return false;
  return std::all_of(ray.heights.begin() + from_surface, ray.heights.end(),
                     [&](double height) { return std::abs(height) <= clear_radius; });
}

}  // namespace

/// OSLO's rule and the self-consistent alternatives (docs/optics.md).
/// Of the five, `oslo` alone gives the thesis' 0.159 for table 3.4.
NumericalAperture numerical_aperture(const System& system) {
  const Stop& stop = stop_of(system);
  const double m = std::abs(retina_image(system).magnification);
  const double index = system.surfaces.front().index;
  const double distance = system.surfaces.front().thickness;
  const auto sine = [](double tangent) { return std::sin(std::atan(tangent)); };
  NumericalAperture aperture;
  aperture.object_beam = index * sine(stop.radius / distance);
  aperture.oslo = aperture.object_beam / m;
  aperture.image_beam = traced_image_aperture(system, stop.radius);
  // Height at the stop's surface per reduced angle at the retina's vertex.
  const double height =
      (system_matrix(system, 2, stop.surface) * transfer_matrix(distance, index))(1, 0) * index;
  aperture.object_stop = index * sine(stop.radius / std::abs(height));
  // Abbe's sine condition: n sin u = |m| n' sin u'.
  aperture.image_stop = aperture.object_stop / m;
  return aperture;
}

/// (4.1), delta = (n / A_N) (1 + m) c; the thesis pairs the vitreous' index with the image side's
/// A_N.
DepthOfFocus depth_of_focus(const System& system, double confusion) {
  detail::require(confusion > 0 && std::isfinite(confusion),
                  "confusion: must be finite and positive");
  const NumericalAperture aperture = numerical_aperture(system);
  const double spread = (1 + std::abs(retina_image(system).magnification)) * confusion;
  const double vitreous = system.surfaces.front().index;
  const double behind = system.surfaces.back().index;
  // (4.1)
  return {vitreous / aperture.oslo * spread, behind / aperture.oslo * spread,
          vitreous / aperture.object_beam * spread};
}

/// Depth of focus over the slope of image distance against depth: the secant of figure 3.4(b), or
/// m^2 n_i / n_v at the retina.
/// The two are not the same: the image moves faster, the nearer to the lens its object is, so the
/// retina's slope is the smallest.
DepthOfField depth_of_field(const System& system, double confusion, double range) {
  const DepthOfFocus focus = depth_of_focus(system, confusion);
  const auto secant = secant_slope(system, range);
  if (!secant) throw std::invalid_argument("range: the image passes infinity within it");
  const double slope = retina_image(system).longitudinal;
  return {focus.thesis / *secant, focus.thesis / slope, focus.image_side / slope};
}

/// From the stop's center both ways, inwards by reversibility and outwards, so nothing needs to be
/// aimed. The field angle then follows from where the ray meets the retina. A ray that is lost is
/// returned as far as it came, with `complete` false.
ChiefRay chief_ray_at_stop(const System& system, double angle) {
  const Stop& stop = stop_of(system);
  detail::require(std::abs(angle) < std::numbers::pi / 2, "angle: must lie within -pi/2 and pi/2");
  const Eigen::Vector3d center(0, 0, system.vertex(stop.surface));
  const Eigen::Vector3d out(std::sin(angle), 0, std::cos(angle));
  ChiefRay chief;
  TraceResult inwards{{center, -out}, TraceStatus::ok, 0};
  if (stop.surface > 2) inwards = trace_in(before_stop(system, stop.surface), inwards.ray);
  if (inwards.status != TraceStatus::ok) return chief;
  const auto point = on_retina(system.surfaces.front(), inwards.ray);
  if (!point) return chief;
  // The ray comes from the other side of the axis than it leaves to, hence the minus.
  chief.field_angle = std::atan2(-point->x(), center.z() - point->z());
  chief.heights.push_back(point->x());
  if (stop.surface > 2) {
    // Out again along the same ray, for the heights on the surfaces before the stop.
    follow_out(before_stop(system, stop.surface), {*point, -inwards.ray.direction}, chief.heights);
  }
  const TraceResult outwards =
      follow_out(from_stop(system, stop.surface), {center, out}, chief.heights);
  chief.complete =
      outwards.status == TraceStatus::ok && static_cast<int>(chief.heights.size()) == system.size();
  if (chief.complete)
    chief.exit_angle = std::atan2(outwards.ray.direction.x(), outwards.ray.direction.z());
  return chief;
}

/// Half illumination: at the edge of this field the observer's pupil center sees the rim of the
/// eye's entrance pupil.
FieldOfView direct_field_of_view(const System& system, double observer_distance) {
  const Stop& stop = stop_of(system);
  detail::require(observer_distance > 0 && std::isfinite(observer_distance),
                  "observer_distance: must be finite and positive");
  // The stop seen from outside: imaged through its own surface and what follows.
  const Eigen::Matrix2d a = system_matrix(system, stop.surface);
  const double behind = system.surfaces.back().index;
  // Image of the stop through these surfaces: position -n_i a10 / a00 and magnification 1 / a00, as
  // in axial_image.
  const double pupil = -behind * a(1, 0) / a(0, 0);
  const double radius = std::abs(stop.radius / a(0, 0));
  return {
      2 * std::atan(radius / (observer_distance - pupil)),
      "entrance pupil seen from " + std::to_string(observer_distance * 1e3) + " mm before the eye"};
}

/// Marches outwards to the first lost or clipped chief ray, then bisects.
/// Marched from the axis rather than bisected from the start, because the field ends at the first
/// ray that is lost, whether or not rays come through again farther out.
FieldOfView vignetted_field_of_view(const System& system, int from_surface, double clear_radius) {
  constexpr double kStep = 0.25 * std::numbers::pi / 180;
  constexpr double kWidest = 80 * std::numbers::pi / 180;
  constexpr double kFine = 1e-9;
  stop_of(system);
  if (from_surface < 2 || from_surface >= system.size()) {
    throw std::invalid_argument("from_surface: must be a refracting surface before the last");
  }
  detail::require(clear_radius > 0, "clear_radius: must be positive");
  ChiefRay inside;
  ChiefRay tried;
  double good = 0;
  double bad = kWidest;
  for (double angle = kStep; angle < kWidest; angle += kStep) {
    if (!passes(system, angle, from_surface, clear_radius, tried)) {
      bad = angle;
      break;
    }
    good = angle;
    inside = tried;
  }
  for (; bad - good > kFine;) {
    const double middle = (good + bad) / 2;
    if (passes(system, middle, from_surface, clear_radius, tried)) {
      good = middle;
      inside = tried;
    } else {
      bad = middle;
    }
  }
  // The first ray outside tells what ends the field: it comes through, but too far out, or it is
  // lost.
  (void)passes(system, bad, from_surface, clear_radius, tried);
  return {2 * std::abs(inside.field_angle), tried.complete ? "rim of the lens" : "rays are lost"};
}

}  // namespace vitreo::optics
