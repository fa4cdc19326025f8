// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/body_shape.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>

namespace vitreo::sim {
namespace {

// S of the ellipsoid p.S p = 1 with semi-axes a, b, c along axis, side and their cross product: in
// the norm sqrt(p.S p) it is the unit ball.
// In that norm a line's distance from the middle is 1 where it touches the ellipsoid, which is what
// hit() and the antialiasing use.
Eigen::Matrix3d ellipsoid(const Eigen::Vector3d& axis, const Eigen::Vector3d& side, double a,
                          double b, double c) {
  const Eigen::Vector3d third = axis.cross(side);
  return axis * axis.transpose() / (a * a) + side * side.transpose() / (b * b) +
         third * third.transpose() / (c * c);
}

}  // namespace

// A soft robot of two crossed plates (thesis 6.1; facts/magnetics 3.1): two ellipsoids of the
// outline, each thin in one direction across the axis.
Figure figure_of(const View& view, const BodyState& body, const BodyLook& look) {
  Figure figure;
  figure.center = view.point_in_view(body.position);
  const Eigen::Vector3d axis = view.view_from_world * body.axis;
  const Eigen::Vector3d side = view.view_from_world * body.side;
  figure.side = (side - side.dot(axis) * axis).normalized();
  figure.across = axis.cross(figure.side);
  const double a = body.semi_axis;
  const double b = body.semi_radius;
  const double thin = look.plate_thickness / 2;
  figure.shapes[0] = ellipsoid(axis, figure.side, a, b, thin > 0 ? thin : b);
  if (thin > 0) {
    figure.shapes[1] = ellipsoid(axis, figure.side, a, thin, b);
    figure.count = 2;
  }
  return figure;
}

// The line o + t d in the norm of S: its least squared distance from the middle is o.S o - (o.S
// d)^2 / d.S d, and where that is below 1 it leaves at the larger root t of |o + t d|^2 = 1. Of two
// ellipsoids the one that is left last hides the other. A line that just misses has its nearest
// point, so that edges can be softened.
Hit hit(const Figure& figure, const PixelLine& line) {
  const Eigen::Vector3d o = Eigen::Vector3d(line.x, line.y, 0) - figure.center,
                        d(line.dx, line.dy, 1);
  Hit nearest;
  double furthest_up = -1e9;
  for (int k = 0; k < figure.count; ++k) {
    const Eigen::Matrix3d& shape = figure.shapes[static_cast<std::size_t>(k)];
    const Eigen::Vector3d so = shape * o;
    const Eigen::Vector3d sd = shape * d;
    const double dd = d.dot(sd);
    const double od = o.dot(sd);
    const double closest = o.dot(so) - od * od / dd;
    if (!std::isfinite(closest)) return {};  // where the optics let no ray through
    nearest.closest = std::min(nearest.closest, std::max(closest, 0.0));
    if (closest > kWellOutside) continue;
    const double t = (-od + std::sqrt(dd * std::max(1 - closest, 0.0))) / dd;
    if (closest < 1 ? t > furthest_up : furthest_up < -1e8) {
      if (closest < 1) furthest_up = t;
      nearest.position = o + t * d;
      nearest.normal = (so + t * sd).normalized();
    }
  }
  return nearest;
}

}  // namespace vitreo::sim
