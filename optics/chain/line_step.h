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

/// A surface as it stands in the chain. Its turn is made once: a frame asks for hundreds of lines.
template <class T>
struct ChainStep {
  ChainSurface<T> surface;
  Eigen::Matrix<T, 3, 3> turn;  // nominal eye frame from the surface's own
  Vector3<T> vertex;
  T ratio;  // index outside / inside
};

/// `numbers` as SurfaceNumbers.
template <class T>
ChainStep<T> chain_step(const Surface& shape, const Eigen::Matrix<T, 7, 1>& numbers) {
  const auto& [a4, a6, a8, a10] = shape.aspheric;
  return {{numbers[5], T(shape.conic), {T(a4), T(a6), T(a8), T(a10)}, is_asphere(shape)},
          turned_by(numbers[3], numbers[4]),
          {numbers[0], numbers[1], numbers[2]},
          numbers[6]};
}

/// What happens at a surface, in its own frame: where it is hit, its unit normal there, and the
/// direction inwards before it, with the cosines of Snell's law.
template <class T>
struct ChainRefraction {
  Vector3<T> hit;
  Vector3<T> normal;
  Vector3<T> direction;
  T cos_in;
  T cos_out;
};

/// The line on the inner side of a surface whose outer side it meets. Snell's law in vector form,
/// as refract(). False where it misses or all is reflected.
template <class T>
bool refract_inwards(const ChainStep<T>& at, LineOf<T>& line, ChainRefraction<T>& made) {
  using std::sqrt;
  const Vector3<T> at_vertex(line[0] + line[2] * at.vertex.z() - at.vertex.x(),
                             line[1] + line[3] * at.vertex.z() - at.vertex.y(), T(0));
  const T length = sqrt(1.0 + line[2] * line[2] + line[3] * line[3]);
  const Vector3<T> outwards(line[2] / length, line[3] / length, 1.0 / length);
  const Vector3<T> d = at.turn.transpose() * -outwards;
  const Vector3<T> origin = at.turn.transpose() * at_vertex;
  const T to_plane = -origin.z() / d.z();
  const Vector3<T> plane_point(origin.x() + to_plane * d.x(), origin.y() + to_plane * d.y(), T(0));
  T s(0);
  const TraceStatus met = at.surface.asphere ? meet_asphere(at.surface, plane_point, d, s)
                                             : meet_conic(at.surface, plane_point, d, s);
  if (met != TraceStatus::ok) return false;
  made.hit = plane_point + s * d;
  made.normal = unit_normal(at.surface, made.hit);
  made.direction = d;
  made.cos_in = d.dot(made.normal);
  const T cos2_out = 1.0 - at.ratio * at.ratio * (1.0 - made.cos_in * made.cos_in);
  if (!(cos2_out >= 0.0)) return false;
  made.cos_out = -sqrt(cos2_out);  // inwards, against the normal
  const Vector3<T> inwards = at.ratio * d + (made.cos_out - at.ratio * made.cos_in) * made.normal;
  line = line_through<T>(at.vertex + at.turn * made.hit, at.turn * inwards);
  return true;
}

}  // namespace vitreo::optics::detail
