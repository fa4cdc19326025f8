// Bundles that are aimed and focused by a plain loop, for the tests of the wide-angle map: through
// the eye's stop, or by a microscope that is focused on each point.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/maps/wide_angle_map.h"
#include "tests/optics/conicoid_reference.h"

#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <optional>
#include <vector>

namespace vitreo::optics::reference {

inline constexpr double kFar = std::numeric_limits<double>::infinity();

/// Where the ray from a point with a slope lands in the pupil's plane (or its slope there).
using Landing = std::function<Vector2d(const Vector2d& slope)>;

inline Line from(const Vector3d& point, const Vector2d& slope) {
  return {point, Vector3d(slope.x(), slope.y(), 1).normalized()};
}

/// The slope whose ray lands at the target: Newton's method by differences.
inline Vector2d aimed(const Landing& landing, const Vector2d& target, Vector2d slope) {
  for (int i = 0; i < 12; ++i) {
    const double h = 1e-6;
    Matrix2d change;
    for (int k = 0; k < 2; ++k) {
      change.col(k) =
          (landing(slope + h * Vector2d::Unit(k)) - landing(slope - h * Vector2d::Unit(k))) /
          (2 * h);
    }
    const double det = change(0, 0) * change(1, 1) - change(0, 1) * change(1, 0);
    const Vector2d off = target - landing(slope);
    slope += Vector2d(change(1, 1) * off.x() - change(0, 1) * off.y(),
                      change(0, 0) * off.y() - change(1, 0) * off.x()) /
             det;
    if (off.norm() < 1e-13) break;
  }
  return slope;
}

/// The bundle's best focus, and where its chief ray is there.
inline AerialPoint focused(const System& system, const WideAngleSettings& s, const Vector3d& point,
                           const Landing& landing, const Vector2d& center, double radius) {
  const double last = last_z(system);
  Vector2d start = -point.head<2>() / (vertex_z(system, 3) - point.z());
  start = aimed(landing, center, start);
  std::vector<Vector2d> x;
  std::vector<Vector2d> u;
  Vector2d mean_x(0, 0);
  Vector2d mean_u(0, 0);
  for (int i = 0; i < s.rings; ++i) {
    for (int j = 0; j < s.arms; ++j) {
      const double r = std::sqrt((i + 0.5) / s.rings) * radius;
      const double a = 2 * std::numbers::pi * j / s.arms;
      const Vector2d target = center + r * Vector2d(std::cos(a), std::sin(a));
      const Line ray = *out(system, from(point, aimed(landing, target, start)));
      x.push_back(ray.at_z(last).head<2>());
      u.push_back(ray.slope());
      mean_x += x.back();
      mean_u += u.back();
    }
  }
  const double n = double(x.size());
  mean_x /= n;
  mean_u /= n;
  double both = 0;
  double slopes = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    both += (x[i] - mean_x).dot(u[i] - mean_u);
    slopes += (u[i] - mean_u).squaredNorm();
  }
  AerialPoint image;
  image.focus = -both / slopes;
  const Line chief = *out(system, from(point, start));
  image.m = chief.at_z(last + image.focus).head<2>();
  return image;
}

inline AerialPoint through_stop(const System& system, const WideAngleSettings& s,
                                const Vector3d& point) {
  const double z = vertex_z(system, system.stop->surface);
  const Landing landing = [&](const Vector2d& slope) -> Vector2d {
    return out(system, from(point, slope), system.stop->surface)->at_z(z).head<2>();
  };
  return focused(system, s, point, landing, {0, 0}, system.stop->radius);
}

/// By the microscope in one place of its focus.
inline AerialPoint at_focus(const System& system, const WideAngleSettings& s, const Vector3d& point,
                            double focus) {
  Microscope m = *s.microscope;
  m.focus = focus;
  const Vector3d axis = axes_of(m).col(2);
  const double tangent = std::tan(std::asin(m.numerical_aperture));
  if (std::isinf(m.pupil_distance)) {
    const Landing landing = [&](const Vector2d& slope) {
      return out(system, from(point, slope))->slope();
    };
    return focused(system, s, point, landing, axis.head<2>() / axis.z(), tangent);
  }
  const Vector3d pupil = pivot_of(system, m) + m.pupil_distance * axis;
  const Landing landing = [&](const Vector2d& slope) -> Vector2d {
    return out(system, from(point, slope))->at_z(pupil.z()).head<2>();
  };
  return focused(system, s, point, landing, pupil.head<2>(), std::abs(m.pupil_distance) * tangent);
}

/// Focused until the best focus lies in the microscope's plane: regula falsi.
inline AerialPoint through_microscope(const System& system, const WideAngleSettings& s,
                                      const Vector3d& point) {
  const Vector3d axis = axes_of(*s.microscope).col(2);
  AerialPoint image;
  const auto off = [&](double focus) {
    image = at_focus(system, s, point, focus);
    return (Vector3d(image.m.x(), image.m.y(), image.focus) -
            Vector3d(s.microscope->decenter.x(), s.microscope->decenter.y(), focus))
        .dot(axis);
  };
  double a = 12e-3;
  double fa = off(a);
  double b = a + fa;
  for (int i = 0; i < 20 && std::abs(b - a) > 1e-14; ++i) {
    const double fb = off(b);
    const double next = b - fb * (b - a) / (fb - fa);
    a = b;
    fa = fb;
    b = std::isfinite(next) ? next : b;
  }
  off(b);
  return image;
}

inline AerialPoint seen(const System& system, const WideAngleSettings& s, const Vector3d& point) {
  return s.microscope ? through_microscope(system, s, point) : through_stop(system, s, point);
}

/// A point by its field: on a line through the stop's center, before the retina.
inline Vector3d in_field(const System& system, double angle, double azimuth, double depth) {
  const Vector3d center(0, 0, vertex_z(system, 3));
  const Vector3d u(-std::sin(angle) * std::cos(azimuth), -std::sin(angle) * std::sin(azimuth),
                   std::cos(angle));
  const Vector3d retina = *meet(system.surfaces[0], {center, u});
  return retina + depth * u;
}

/// A system, the settings of its map, and whether that is symmetric.
struct Case {
  const char* name;
  System system;
  WideAngleSettings settings;
  bool symmetric;
};

inline Case make(const char* name, bool symmetric, std::optional<double> pupil = std::nullopt,
                 const Vector2d& decenter = {0, 0}, const Vector2d& tilt = {0, 0}) {
  Case c{name, spheres(), {}, symmetric};
  if (pupil) {
    Microscope m;
    m.numerical_aperture = 0.012;
    m.focus = 9e-3;  // moved as it is focused
    m.pupil_distance = *pupil;
    m.decenter = decenter;
    m.tilt = tilt;
    c.settings.microscope = m;
  }
  c.settings.max_angle = 0.27;
  c.settings.max_depth = 6.3e-3;
  // a stop's wide bundle asks for more arms, or its focus would depend on where they point
  c.settings.rings = pupil ? 3 : 4;
  c.settings.arms = pupil ? 7 : 20;
  c.settings.angle_nodes = 12;
  c.settings.depth_nodes = 9;
  return c;
}

}  // namespace vitreo::optics::reference
