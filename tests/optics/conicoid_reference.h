// Rays through conicoids by a plain loop, for the tests of what is made of
// traced rays: the quadratic from the vertex plane and Snell's law with the
// angles written out. SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/rays/observer.h"
#include "optics/system/system.h"

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/LU>

#include <cmath>
#include <optional>

namespace vitreo::optics::reference {

using Eigen::Matrix2d;
using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

/// A straight line; `along` is unit and points to where the light goes.
struct Line {
  Vector3d at;
  Vector3d along;
  Vector3d at_z(double z) const { return at + along * ((z - at.z()) / along.z()); }
  Vector2d slope() const { return along.head<2>() / along.z(); }
};

inline Matrix3d about_x(double a) {
  Matrix3d r;
  r << 1, 0, 0, 0, std::cos(a), -std::sin(a), 0, std::sin(a), std::cos(a);
  return r;
}
inline Matrix3d about_y(double a) {
  Matrix3d r;
  r << std::cos(a), 0, std::sin(a), 0, 1, 0, -std::sin(a), 0, std::cos(a);
  return r;
}

inline double vertex_z(const System& system, int surface) {
  double z = 0;
  for (int i = 1; i < surface; ++i) z += system.surfaces[i - 1].thickness;
  return z;
}
inline double last_z(const System& system) { return vertex_z(system, system.size()); }

/// Where a line meets a surface on its vertex' sheet, in the surface's frame;
/// nothing where it misses.
inline std::optional<Vector3d> meet(const Surface& s, const Line& line) {
  const double c = 1 / s.radius;
  const double k = 1 + s.conic;
  const Vector3d p = line.at_z(0);
  const Vector3d& d = line.along;
  const double a2 = c * (d.x() * d.x() + d.y() * d.y() + k * d.z() * d.z());
  const double a1 = 2 * c * (p.x() * d.x() + p.y() * d.y()) - 2 * d.z();
  const double a0 = c * (p.x() * p.x() + p.y() * p.y());
  if (std::abs(a2) < 1e-300) return p - d * (a0 / a1);
  const double under = a1 * a1 - 4 * a2 * a0;
  if (under < 0) return std::nullopt;
  // the root that goes to zero with a0: its point lies on the sheet of the
  // vertex
  const double t = 2 * a0 / (-a1 + (a1 < 0 ? 1 : -1) * std::sqrt(under));
  const Vector3d at = p + t * d;
  if (1 - k * c * at.z() <= 0) return std::nullopt;
  return at;
}

/// Through one surface, from index n to index n2, either way.
inline std::optional<Line> refracted(const System& system, int surface, const Line& line, double n,
                                     double n2) {
  const Surface& s = system.surfaces[surface - 1];
  const Vector3d origin = Vector3d(0, 0, vertex_z(system, surface)) + s.placement.decenter;
  const Matrix3d axes = about_x(s.placement.tilt.x()) * about_y(s.placement.tilt.y());
  const Line local{axes.transpose() * (line.at - origin), axes.transpose() * line.along};
  const std::optional<Vector3d> at = meet(s, local);
  if (!at) return std::nullopt;
  Vector3d normal(-at->x() / s.radius, -at->y() / s.radius, 1 - (1 + s.conic) * at->z() / s.radius);
  normal.normalize();
  if (normal.dot(local.along) < 0) normal = -normal;
  const Vector3d across = local.along - normal * normal.dot(local.along);  // of length sin
  const Vector3d behind = across * (n / n2);
  if (behind.squaredNorm() >= 1) return std::nullopt;
  const Vector3d along = behind + normal * std::sqrt(1 - behind.squaredNorm());
  return Line{origin + axes * *at, axes * along};
}

/// From the vitreous out behind the last surface; with `to`, only through
/// surfaces before that.
inline std::optional<Line> out(const System& system, Line line, int to = 0) {
  const int end = to > 0 ? to : system.size() + 1;
  for (int i = 2; i < end; ++i) {
    const auto next =
        refracted(system, i, line, system.surfaces[i - 2].index, system.surfaces[i - 1].index);
    if (!next) return std::nullopt;
    line = *next;
  }
  return line;
}

/// From behind the last surface into the vitreous, turned round so that it goes
/// towards +z; nothing where it is lost. The stop is looked at by what lies on
/// either side of its surface.
inline std::optional<Line> in(const System& system, Line line) {
  line.along = -line.along;
  for (int i = system.size(); i >= 2; --i) {
    const auto next =
        refracted(system, i, line, system.surfaces[i - 1].index, system.surfaces[i - 2].index);
    if (!next) return std::nullopt;
    if (system.stop && system.stop->surface == i) {
      const double z = vertex_z(system, i);
      const Line& there = next->at.z() < z ? line : *next;
      if (there.at_z(z).head<2>().norm() > system.stop->radius) return std::nullopt;
    }
    line = *next;
  }
  line.along = -line.along;
  return line;
}

/// The microscope's axes as columns: turned about x, then about y.
inline Matrix3d axes_of(const Microscope& microscope) {
  return about_y(microscope.tilt.y()) * about_x(microscope.tilt.x());
}
/// Where its axis meets the plane in focus.
inline Vector3d pivot_of(const System& system, const Microscope& microscope) {
  return {microscope.decenter.x(), microscope.decenter.y(), last_z(system) + microscope.focus};
}

/// The chief ray of m behind the eye.
inline Line chief_ray(const System& system, const Microscope& microscope, const Vector2d& m) {
  const Matrix3d axes = axes_of(microscope);
  const Vector3d pivot = pivot_of(system, microscope);
  const Vector3d at = pivot + m.x() * axes.col(0) + m.y() * axes.col(1);
  if (std::isinf(microscope.pupil_distance)) return {at, axes.col(2)};
  const Vector3d along = pivot + microscope.pupil_distance * axes.col(2) - at;
  return {at, along.normalized() * (along.z() < 0 ? -1 : 1)};
}

/// The isopixel line of m.
inline std::optional<Line> isopixel(const System& system, const Microscope& microscope,
                                    const Vector2d& m) {
  return in(system, chief_ray(system, microscope, m));
}

/// Derivatives of an isopixel line by m: differences of steps h and 2h, without
/// their cubic terms.
struct LineChange {
  Matrix2d at_z;
  Matrix2d slope;
};
inline LineChange change_of(const System& system, const Microscope& microscope, const Vector2d& m,
                            double z) {
  const double h = 2e-5;
  LineChange change;
  for (int k = 0; k < 2; ++k) {
    Vector2d x[4];
    Vector2d s[4];
    for (int i = 0; i < 4; ++i) {
      const double steps[] = {-2, -1, 1, 2};
      const Line line = *isopixel(system, microscope, m + Vector2d::Unit(k) * (steps[i] * h));
      x[i] = line.at_z(z).head<2>();
      s[i] = line.slope();
    }
    change.at_z.col(k) = (8 * (x[2] - x[1]) - (x[3] - x[0])) / (12 * h);
    change.slope.col(k) = (8 * (s[2] - s[1]) - (s[3] - s[0])) / (12 * h);
  }
  return change;
}

inline Surface surface(double radius_mm, double thickness_mm, double index, double conic = 0) {
  Surface s;
  s.radius = radius_mm * 1e-3;
  s.thickness = thickness_mm * 1e-3;
  s.index = index;
  s.conic = conic;
  return s;
}

/// An eye and a condensing lens of spheres alone, with indices and lengths that
/// are no table's.
inline System spheres() {
  System system;
  system.name = "spheres";
  system.surfaces = {surface(11.9, 15.2, 1.371), surface(21.3, 3.7, 1.478),
                     surface(-13.1, 3.1, 1.352), surface(29.0, 1.4, 1.409),
                     surface(-10.2, 4.4, 1.0),   surface(17.6, 9.0, 1.543),
                     surface(-12.4, 0, 1.0)};
  system.stop = Stop{3, 1.7e-3};
  return system;
}

}  // namespace vitreo::optics::reference
