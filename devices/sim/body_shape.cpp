// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/body_shape.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <optional>

namespace vitreo::sim {
namespace {

/// A line through the body's frame of symmetry: `near` is its point nearest to the center, `along`
/// its unit vector towards the observer.
struct SolidLine {
  Eigen::Vector3d near;
  Eigen::Vector3d along;
  double cosine;  // of the angle between line and axis
  /// Of `near`, along the axis' shadow and across it, both positive: the shadow is symmetric.
  double x;
  double y;

  SolidLine(const Figure& figure, const Eigen::Vector3d& origin, const Eigen::Vector3d& direction)
      : along(direction.normalized()) {
    near = origin - origin.dot(along) * along;
    cosine = std::min(std::abs(figure.axis.dot(along)), 1.0);
    const Eigen::Vector3d shadow = figure.axis - figure.axis.dot(along) * along;
    const double sine = shadow.norm();
    x = sine > 1e-9 ? std::abs(near.dot(shadow)) / sine : 0;
    y = std::sqrt(std::max(near.squaredNorm() - x * x, 0.0));
  }
  double sine() const { return std::sqrt(std::max(1 - cosine * cosine, 0.0)); }
};

/// The shadow of a cylinder, and of a rod, is a segment of half length `half` swept by an ellipse
/// of `e` along it and `w` across. By which factor it must grow about its middle to reach (x, y):
/// the straight sides where y / w reaches over x, else the smaller root g of
///   (x - g half)^2 / e^2 + y^2 / w^2 = g^2,
/// written so that e may vanish.
double swept_ellipse(double half, double e, double w, double x, double y) {
  const double side = y / w;
  if (side * half >= x) return side;
  const double squares = x * x + e * e * side * side;
  const double root = e * std::sqrt(std::max(squares - half * half * side * side, 0.0));
  return squares / (x * half + root);
}

/// Distance of a point outside of an ellipse (e0 >= e1) in its first quadrant, 0 inside: the
/// nearest point is (e0^2 x / (t + e0^2), e1^2 y / (t + e1^2)), and Newton's method from the left
/// finds the t that puts it on the ellipse, since that function of t is convex and falls (Eberly
/// 2013).
double beyond_ellipse(double e0, double e1, double x, double y) {
  constexpr double kThin = 1e-6;  // of e0: a segment
  if (!(e1 > kThin * e0)) return std::hypot(std::max(x - e0, 0.0), y);
  if (x * x / (e0 * e0) + y * y / (e1 * e1) <= 1) return 0;
  double t = std::max({0.0, e1 * y - e1 * e1, e0 * x - e0 * e0});
  for (int step = 0; step < 30; ++step) {
    const double p = e0 * x / (t + e0 * e0);
    const double q = e1 * y / (t + e1 * e1);
    const double excess = p * p + q * q - 1;
    const double slope = -2 * (p * p / (t + e0 * e0) + q * q / (t + e1 * e1));
    const double next = t - excess / slope;
    if (!(next > t * (1 + 1e-12))) break;
    t = next;
  }
  return std::hypot(x - e0 * e0 * x / (t + e0 * e0), y - e1 * e1 * y / (t + e1 * e1));
}

/// The distance of a line from a solid's middle, 1 at the rim. A disc's is that beyond its flat
/// middle, over its radius: near the rim all that is asked of it is where 1 is and how steep.
double distance_of(const Figure& figure, const SolidLine& line) {
  const double a = figure.semi_axis;
  const double b = figure.semi_radius;
  if (figure.solid == Solid::cylinder)
    return swept_ellipse(a * line.sine(), b * line.cosine, b, line.x, line.y);
  if (figure.solid == Solid::rod) return swept_ellipse((a - b) * line.sine(), b, b, line.x, line.y);
  const double far = line.near.norm() / b;
  if (far > 1.2) return far;
  return 1 + (beyond_ellipse(b - a, (b - a) * line.cosine, line.y, line.x) - a) / b;
}

/// Where a line leaves a surface of revolution with its middle `up` along the axis: its farthest
/// point that passes.
struct Exit {
  double t = -1e9;
  Eigen::Vector3d normal{0, 0, 1};
};

/// The larger root t of |o + t d|^2 = radius^2, none where the line misses.
std::optional<double> last_root(const Eigen::Vector3d& o, const Eigen::Vector3d& d, double radius) {
  const double dd = d.squaredNorm();
  const double od = o.dot(d);
  const double inside = od * od - dd * (o.squaredNorm() - radius * radius);
  if (!(dd > 0) || !(inside >= 0)) return std::nullopt;
  return (-od + std::sqrt(inside)) / dd;
}

/// The line against the mantle of radius b between the heights -half and half, and against what
/// closes it there: flat ends, or balls.
Exit leave_mantle(const Figure& figure, const SolidLine& line, double half, bool flat) {
  const double b = figure.semi_radius;
  const auto across = [&](const Eigen::Vector3d& p) -> Eigen::Vector3d {
    return p - p.dot(figure.axis) * figure.axis;
  };
  Exit exit;
  const auto take = [&](double t, const Eigen::Vector3d& normal) {
    if (t > exit.t) exit = {t, normal};
  };
  const auto side = last_root(across(line.near), across(line.along), b);
  if (side) {
    const Eigen::Vector3d p = line.near + *side * line.along;
    if (std::abs(p.dot(figure.axis)) <= half) take(*side, across(p) / b);
  }
  for (const double end : {-half, half}) {
    const Eigen::Vector3d middle = end * figure.axis;
    const double rate = figure.axis.dot(line.along);
    if (flat && std::abs(rate) > 1e-9) {
      const double t = (end - figure.axis.dot(line.near)) / rate;
      const Eigen::Vector3d p = line.near + t * line.along;
      if (across(p).norm() <= b * (1 + 1e-9)) take(t, end < 0 ? -figure.axis : figure.axis);
    } else if (!flat) {
      const auto t = last_root(line.near - middle, line.along, b);
      if (t) take(*t, (line.near + *t * line.along - middle) / b);
    }
  }
  return exit;
}

/// The line against a disc with a round edge, all points within a of a flat disc of radius b - a:
/// down from the observer by as much as there is room (sphere tracing, Hart 1996).
Exit leave_disc(const Figure& figure, const SolidLine& line) {
  const double a = figure.semi_axis;
  const double flat = figure.semi_radius - a;
  Exit exit{1.01 * (figure.semi_radius + a), {0, 0, 1}};
  for (int step = 0; step < 60; ++step) {
    const Eigen::Vector3d p = line.near + exit.t * line.along;
    const Eigen::Vector3d out = p - p.dot(figure.axis) * figure.axis;
    const double radial = out.norm();
    const Eigen::Vector3d nearest = radial > flat ? Eigen::Vector3d(flat / radial * out) : out;
    const double room = (p - nearest).norm() - a;
    exit.normal = (p - nearest).normalized();
    if (room < 1e-3 * a) break;
    exit.t -= room;
  }
  return exit;
}

/// Hit of a solid that is no ellipsoid. A line that just misses is moved inwards to the rim.
Hit solid_hit(const Figure& figure, const Eigen::Vector3d& origin,
              const Eigen::Vector3d& direction) {
  SolidLine line(figure, origin, direction);
  const double distance = distance_of(figure, line);
  Hit made;
  if (!std::isfinite(distance)) return made;
  made.closest = distance * distance;
  if (made.closest > kWellOutside) return made;
  if (distance >= 1) line.near *= 0.9999 / distance;
  const Exit exit =
      figure.solid == Solid::disc
          ? leave_disc(figure, line)
          : leave_mantle(figure, line,
                         figure.solid == Solid::rod ? figure.semi_axis - figure.semi_radius
                                                    : figure.semi_axis,
                         figure.solid == Solid::cylinder);
  made.position = line.near + exit.t * line.along;
  made.normal = exit.normal;
  return made;
}

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
  figure.axis = axis;
  figure.semi_axis = body.semi_axis;
  figure.semi_radius = body.semi_radius;
  figure.solid = look.solid;
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

// The support functions h(n) = max n.p of the solids, as in body.cpp.
double extent_along(const BodyState& body, const BodyLook& look, const Eigen::Vector3d& direction) {
  const double along = std::abs(body.axis.dot(direction));
  const double across = std::sqrt(std::max(1 - along * along, 0.0));
  const double a = body.semi_axis;
  const double b = body.semi_radius;
  switch (look.solid) {
    case Solid::cylinder:
      return a * along + b * across;
    case Solid::rod:
      return (a - b) * along + b;
    case Solid::disc:
      return (b - a) * across + a;
    case Solid::ellipsoid:
      break;
  }
  return std::hypot(a * along, b * across);
}

// The line o + t d in the norm of S: its least squared distance from the middle is o.S o - (o.S
// d)^2 / d.S d, and where that is below 1 it leaves at the larger root t of |o + t d|^2 = 1. Of two
// ellipsoids the one that is left last hides the other. A line that just misses has its nearest
// point, so that edges can be softened; of a plate, whose rim is a thousandth of its width, the
// point just within it: what a pixel on the rim shows of a plate is its flat side, not its edge.
Hit hit(const Figure& figure, const PixelLine& line) {
  constexpr double kWithinPlate = 0.96;  // squared distance; a fiftieth of its width from the rim
  const Eigen::Vector3d o = Eigen::Vector3d(line.x, line.y, 0) - figure.center,
                        d(line.dx, line.dy, 1);
  if (figure.solid != Solid::ellipsoid) return solid_hit(figure, o, d);
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
    const double nearer =
        figure.count > 1 && closest > kWithinPlate ? std::sqrt(kWithinPlate / closest) - 1 : 0;
    const Eigen::Vector3d inwards = nearer * (o - od / dd * d);
    const double t =
        (-od + std::sqrt(dd * std::max(1 - (1 + nearer) * (1 + nearer) * closest, 0.0))) / dd;
    if (closest < 1 ? t > furthest_up : furthest_up < -1e8) {
      if (closest < 1) furthest_up = t;
      nearest.position = o + inwards + t * d;
      nearest.normal = (so + shape * inwards + t * sd).normalized();
    }
  }
  return nearest;
}

}  // namespace vitreo::sim
