// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/body_shape.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>

namespace vitreo::sim {
namespace {

/// One ellipsoid: |p|^2 = p . shape p in the space where it is the unit sphere.
Eigen::Matrix3d ellipsoid(const Eigen::Vector3d& axis, const Eigen::Vector3d& side, double a,
                          double b, double c) {
  const Eigen::Vector3d third = axis.cross(side);
  return axis * axis.transpose() / (a * a) + side * side.transpose() / (b * b) +
         third * third.transpose() / (c * c);
}

}  // namespace

Figure figure_of(const View& view, const BodyState& body, const BodyLook& look) {
  Figure figure;
  figure.center = view.point_in_view(body.position);
  const Eigen::Vector3d axis = view.view_from_world * body.axis;
  const Eigen::Vector3d side = view.view_from_world * body.side;
  figure.side = (side - side.dot(axis) * axis).normalized();
  figure.across = axis.cross(figure.side);
  const double a = body.semi_axis, b = body.semi_radius, thin = look.plate_thickness / 2;
  figure.shapes[0] = ellipsoid(axis, figure.side, a, b, thin > 0 ? thin : b);
  if (thin > 0) {
    figure.shapes[1] = ellipsoid(axis, figure.side, a, thin, b);
    figure.count = 2;
  }
  return figure;
}

Hit hit(const Figure& figure, const PixelLine& line) {
  const Eigen::Vector3d o = Eigen::Vector3d(line.x, line.y, 0) - figure.center,
                        d(line.dx, line.dy, 1);
  Hit nearest;
  double furthest_up = -1e9;
  for (int k = 0; k < figure.count; ++k) {
    const Eigen::Matrix3d& shape = figure.shapes[static_cast<std::size_t>(k)];
    const Eigen::Vector3d so = shape * o, sd = shape * d;
    const double dd = d.dot(sd), od = o.dot(sd), closest = o.dot(so) - od * od / dd;
    if (!std::isfinite(closest)) return {};  // where the optics let no ray through
    nearest.closest = std::min(nearest.closest, std::max(closest, 0.0));
    if (closest > kWellOutside) continue;
    const double t = (-od + std::sqrt(dd * std::max(1 - closest, 0.0))) /
                     dd;  // where the line leaves towards us
    if (closest < 1 ? t > furthest_up : furthest_up < -1e8) {
      if (closest < 1) furthest_up = t;
      nearest.place = o + t * d;
      nearest.normal = (so + t * sd).normalized();
    }
  }
  return nearest;
}

}  // namespace vitreo::sim
