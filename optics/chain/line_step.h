// One step of a line of sight through the viewing chain, from the microscope's pixel into air or
// through one refracting surface, for doubles and for Ceres' Jets. Lines are counted in the nominal
// eye frame by where they cross z = 0 and by their slopes.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/numerics/scalar.h"
#include "optics/system/refraction.h"

#include <Eigen/Core>

#include <array>
#include <cmath>

namespace vitreo::optics::detail {

template <class T>
using LineOf = Eigen::Matrix<T, 4, 1>;

/// A surface whose curvature may carry derivatives, in the form that refraction.h meets.
template <class T>
struct ChainSurface {
  T curvature;
  T conic;
  std::array<T, 4> aspheric;
  bool asphere;
};
template <class T>
const T& curvature_of(const ChainSurface<T>& surface) {
  return surface.curvature;
}
template <class T>
bool is_asphere(const ChainSurface<T>& surface) {
  return surface.asphere;
}

/// About x by t[0], then about y by t[1].
template <class T>
Eigen::Matrix<T, 3, 3> turned_by(const T& about_x, const T& about_y) {
  using std::cos;
  using std::sin;
  const T cx = cos(about_x);
  const T sx = sin(about_x);
  const T cy = cos(about_y);
  const T sy = sin(about_y);
  Eigen::Matrix<T, 3, 3> turn;
  turn << cy, sy * sx, sy * cx, T(0), cx, -sx, -sy, cy * sx, cy * cx;
  return turn;
}

template <class T>
LineOf<T> line_through(const Vector3<T>& point, const Vector3<T>& direction) {
  const T sx = direction.x() / direction.z();
  const T sy = direction.y() / direction.z();
  LineOf<T> line;
  line << point.x() - sx * point.z(), point.y() - sy * point.z(), sx, sy;
  return line;
}

/// The chief ray of an image point m: from (m, 0) in the object plane to the pupil at distance 1 /
/// power, direction (-power m, 1). `numbers` as MicroscopeNumbers; `image` is (center - u, v -
/// center), px.
template <class T>
LineOf<T> line_in_air(const Eigen::Matrix<T, 7, 1>& numbers, const Vector2<T>& image) {
  const Vector2<T> m = image * numbers[6];
  const Eigen::Matrix<T, 3, 3> turn = turned_by(numbers[3], numbers[4]);
  const Vector3<T> point =
      Vector3<T>(numbers[0], numbers[1], numbers[2]) + turn * Vector3<T>(m.x(), m.y(), T(0));
  const Vector3<T> direction = turn * Vector3<T>(-numbers[5] * m.x(), -numbers[5] * m.y(), T(1));
  return line_through(point, direction);
}

/// The line on the inner side of a surface whose outer side it meets. Snell's law in vector form,
/// as refract(). False where it misses or all is reflected.
template <class T>
bool refract_inwards(const Surface& shape, const Eigen::Matrix<T, 7, 1>& numbers, LineOf<T>& line) {
  using std::sqrt;
  const auto& [a4, a6, a8, a10] = shape.aspheric;
  const ChainSurface<T> surface{
      numbers[5], T(shape.conic), {T(a4), T(a6), T(a8), T(a10)}, is_asphere(shape)};
  const Eigen::Matrix<T, 3, 3> turn = turned_by(numbers[3], numbers[4]);
  const Vector3<T> vertex(numbers[0], numbers[1], numbers[2]);
  const Vector3<T> at_vertex(line[0] + line[2] * vertex.z() - vertex.x(),
                             line[1] + line[3] * vertex.z() - vertex.y(), T(0));
  const T length = sqrt(1.0 + line[2] * line[2] + line[3] * line[3]);
  const Vector3<T> outwards(line[2] / length, line[3] / length, 1.0 / length);
  Vector3<T> d = turn.transpose() * -outwards;
  const Vector3<T> origin = turn.transpose() * at_vertex;
  const T to_plane = -origin.z() / d.z();
  const Vector3<T> plane_point(origin.x() + to_plane * d.x(), origin.y() + to_plane * d.y(), T(0));
  T s(0);
  const TraceStatus met = surface.asphere ? meet_asphere(surface, plane_point, d, s)
                                          : meet_conic(surface, plane_point, d, s);
  if (met != TraceStatus::ok) return false;
  const Vector3<T> hit = plane_point + s * d;
  const Vector3<T> normal = unit_normal(surface, hit);
  const T ratio = numbers[6];
  const T cos_in = d.dot(normal);
  const T cos2_out = 1.0 - ratio * ratio * (1.0 - cos_in * cos_in);
  if (!(cos2_out >= 0.0)) return false;
  const T cos_out = -sqrt(cos2_out);  // inwards, against the normal
  d = ratio * d + (cos_out - ratio * cos_in) * normal;
  line = line_through<T>(vertex + turn * hit, turn * d);
  return true;
}

}  // namespace vitreo::optics::detail
