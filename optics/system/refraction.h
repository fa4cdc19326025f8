// Refraction of one ray at one surface: intersection, Snell's law, stop. Templated, so that Ceres'
// Jets pass through the same code: as rays, and as surfaces that are being designed
// (optics/design/design_surface.h). Frame: the eye frame moved so that the surface's vertex is the
// origin. Lengths in m.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/numerics/scalar.h"
#include "optics/system/ray.h"
#include "optics/system/shape.h"

#include <Eigen/Core>

#include <cmath>
#include <limits>

namespace vitreo::optics::detail {

/// `s` such that p + s d lies on the conic, p = plane_point in the vertex plane, d the unit
/// direction. The conic of (3.1) without aspheric terms is F = c (x^2 + y^2 + (1 + k) z^2) - 2 z =
/// 0 with curvature c and conic constant k; on the line this is A s^2 + 2 B s + E = 0 with
///  A = c (1 + k d_z^2),  B = c (p_x d_x + p_y d_y) - d_z,  E = c (p_x^2 + p_y^2).
/// The root s = E / (-B + sqrt(B^2 - A E)) has no cancellation where A -> 0 (near-axial rays on a
/// paraboloid); of the two roots it is the one at the vertex, whichever way the ray goes.
template <class AnySurface, class T>
TraceStatus meet_conic(const AnySurface& surface, const Vector3<T>& plane_point,
                       const Vector3<T>& d, T& s) {
  using std::sqrt;
  const auto c = curvature_of(surface);
  const auto k = surface.conic;
  const T a = c * (1.0 + k * d.z() * d.z());
  const T b = c * (plane_point.x() * d.x() + plane_point.y() * d.y()) - d.z();
  const T e = c * (plane_point.x() * plane_point.x() + plane_point.y() * plane_point.y());
  const T discriminant = b * b - a * e;
  if (!(discriminant >= 0.0)) return TraceStatus::missed;
  const T root = sqrt(discriminant);
  const T denominator = d.z() > 0.0 ? T(root - b) : T(-root - b);
  if (denominator == 0.0) return TraceStatus::missed;
  s = e / denominator;
  // (3.1) is the sheet where its square root, 1 - (1+k) c z, is positive.
  return (1.0 + k) * c * (s * d.z()) > 1.0 ? TraceStatus::wrong_sheet : TraceStatus::ok;
}

/// Newton's method on f(s) = z - sag(r), whose slope is d_z - (sag'(r) / r) (x d_x + y d_y), from
/// the conic's root, or from the tangent plane where the conic is missed or the surface toric. The
/// step after convergence makes the derivatives of a Jet exact.
template <class AnySurface, class T>
TraceStatus meet_asphere(const AnySurface& surface, const Vector3<T>& plane_point,
                         const Vector3<T>& d, T& s) {
  constexpr double kConverged = 1e-14;  // m
  constexpr int kMaxSteps = 30;
  if (is_toric(surface) || meet_conic(surface, plane_point, d, s) != TraceStatus::ok) s = T(0);
  for (int step = 0; step < kMaxSteps; ++step) {
    Vector3<T> normal;
    const T gap = height_over(surface, Vector3<T>(plane_point + s * d), normal);
    const T slope = normal.dot(d);
    if (!(gap == gap) || slope == 0.0) return TraceStatus::missed;
    s -= gap / slope;
    if (gap < kConverged && gap > -kConverged) return TraceStatus::ok;
  }
  return TraceStatus::no_convergence;
}

/// The unit normal at a point of the surface, with positive z component: the gradient of z -
/// sag(r), or for a conic that of -F / 2.
template <class AnySurface, class T>
Vector3<T> unit_normal(const AnySurface& surface, const Vector3<T>& p) {
  if (is_asphere(surface) || is_toric(surface)) {
    Vector3<T> normal;
    (void)height_over(surface, p, normal);
    return normal.normalized();
  }
  const auto c = curvature_of(surface);  // this form stays regular at the equator of a sphere
  return Vector3<T>(-c * p.x(), -c * p.y(), 1.0 - (1.0 + surface.conic) * c * p.z()).normalized();
}

/// Snell's law in vector form (Glassner, An Introduction to Ray Tracing, 1989): with n = `normal`
/// and mu = `ratio` = index before / index behind,
///  d' = mu d + (cos t' - mu cos t) n,  cos t = d . n,  cos^2 t' = 1 - mu^2 (1 - cos^2 t).
/// The sign of cos t' is that of cos t, so the normal may point either way. False at total
/// reflection.
template <class T>
bool refract(double ratio, const Vector3<T>& normal, Vector3<T>& d) {
  using std::sqrt;
  const T cos_in = d.dot(normal);
  const T cos2_out = 1.0 - ratio * ratio * (1.0 - cos_in * cos_in);
  if (!(cos2_out >= 0.0)) return false;
  const T cos_out = cos_in < 0.0 ? T(-sqrt(cos2_out)) : T(sqrt(cos2_out));
  d = ratio * d + (cos_out - ratio * cos_in) * normal;
  return true;
}

/// A surface with the media on both sides, as the ray meets it.
template <class AnySurface>
struct Crossing {
  const AnySurface& surface;
  double ratio;  // index before / index behind, as the ray goes
  double stop_radius = std::numeric_limits<double>::infinity();  // m, of a hole in the vertex plane
  template <class T>
  double ratio_at(const Vector3<T>&) const {
    return ratio;
  }
};

/// The same between media of which one or both have a gradient: the ratio is that at the point.
template <class Ratio>
struct GradedCrossing {
  const Surface& surface;
  Ratio ratio_at;
  double stop_radius = std::numeric_limits<double>::infinity();  // m
};

/// Propagates the ray from its origin to behind the surface; leaves it alone when it is lost.
template <class AnyCrossing, class T>
TraceStatus cross(const AnyCrossing& at, Vector3<T>& origin, Vector3<T>& direction) {
  // m: a path this short is rounding, a longer one means that the surfaces cross
  constexpr double kBackwards = -1e-12;
  if (direction.z() == 0.0) return TraceStatus::missed;
  const T to_plane = -origin.z() / direction.z();
  const Vector3<T> plane_point(origin.x() + to_plane * direction.x(),
                               origin.y() + to_plane * direction.y(), T(0));
  T s(0);
  const TraceStatus met = is_asphere(at.surface) || is_toric(at.surface)
                              ? meet_asphere(at.surface, plane_point, direction, s)
                              : meet_conic(at.surface, plane_point, direction, s);
  if (met != TraceStatus::ok) return met;
  if (!(to_plane + s > kBackwards)) return TraceStatus::missed;
  const Vector3<T> hit = plane_point + s * direction;
  const auto outside = [](const Vector3<T>& p, double radius) {
    return p.x() * p.x() + p.y() * p.y() > radius * radius;
  };
  if (outside(hit, at.surface.semi_diameter)) return TraceStatus::clipped;
  Vector3<T> refracted = direction;
  if (!refract(at.ratio_at(hit), unit_normal(at.surface, hit), refracted))
    return TraceStatus::total_reflection;
  // The hole lies in the vertex plane: before the surface or behind it, by the sign of the sag, so
  // both directions of travel are clipped alike.
  const bool plane_first = (hit.z() >= 0.0) == (direction.z() > 0.0);
  const Vector3<T> in_hole =
      plane_first ? plane_point : Vector3<T>(hit - refracted * (hit.z() / refracted.z()));
  if (outside(in_hole, at.stop_radius)) return TraceStatus::clipped;
  origin = hit;
  direction = refracted;
  return TraceStatus::ok;
}

}  // namespace vitreo::optics::detail
