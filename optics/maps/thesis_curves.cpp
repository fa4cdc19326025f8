// SPDX-License-Identifier: Apache-2.0
#include "optics/maps/thesis_curves.h"

#include "optics/numerics/linear.h"
#include "optics/numerics/preconditions.h"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <functional>
#include <stdexcept>

namespace vitreo::optics {
namespace {

using FieldPosition = WideAngleMap::FieldPosition;
using Plane = WideAngleMap::Plane;
/// A cubic has four coefficients; with a fifth point its residual begins to tell something.
constexpr int kFewest = 5;

/// The zero of f between two ends, by bisection; nothing when f has the same sign or no value at
/// both.
/// Bisection, not Newton's method: f has no value where the map ends or folds. Fifty halvings of an
/// angle or a depth reach rounding.
std::optional<double> root(const std::function<std::optional<double>(double)>& f, double from,
                           double to) {
  constexpr int kHalvings = 50;
  const auto first = f(from);
  const auto last = f(to);
  if (!(first && last && *first * *last <= 0)) return std::nullopt;
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = (from + to) / 2;
    const auto there = f(middle);
    if (!there) return std::nullopt;
    (*there * *first > 0 ? from : to) = middle;
  }
  return (from + to) / 2;
}

/// Points in focus at one sensor position d_ls: for each field angle the depth at which the map's
/// focus is `focus` (thesis 3.2: the isofocus surface).
/// Angles under which no depth has this focus are left out, as the surface leaves the map there.
std::vector<Plane> isofocus_points(const WideAngleMap& map, double focus, int samples) {
  std::vector<Plane> points;
  for (int i = 0; i < samples; ++i) {
    const double angle = map.max_angle() * i / (samples - 1);
    const auto depth = root(
        [&](double x) -> std::optional<double> {
          const auto there = map.at({angle, x});
          return there ? std::optional(there->focus - focus) : std::nullopt;
        },
        0, map.max_depth());
    if (depth) points.push_back(map.plane_point({angle, *depth}));
  }
  return points;
}

/// Points imaged at one height d_op: for each depth the field angle at which the map's height is
/// `height` (thesis 3.2: the isopixel curve).
/// As isofocus_points, with the roles of angle and depth exchanged; `height` is |d_op|, m.
std::vector<Plane> isopixel_points(const WideAngleMap& map, double height, int samples) {
  std::vector<Plane> points;
  for (int i = 0; i < samples; ++i) {
    const double depth = map.max_depth() * i / (samples - 1);
    const auto angle = root(
        [&](double x) -> std::optional<double> {
          const auto there = map.at({x, depth});
          return there ? std::optional(std::abs(there->height) - height) : std::nullopt;
        },
        0, map.max_angle());
    if (angle) points.push_back(map.plane_point({*angle, depth}));
  }
  return points;
}

/// A point's distance from the conic F = r^2 + (1 + k) u^2 - 2 R u = 0, u = z - z0, to first order:
/// F / |grad F| (Sampson 1982), and its change with radius and pole, |grad F| held.
struct Distance {
  double value;
  double per_radius;
  double per_pole;
};

/// In meters; the conic constant is held, as 3.2.1 sets it to the retina's.
Distance distance(double radius, double conic, double pole, const Plane& at) {
  const double u = at.z - pole;
  const double normal = (1 + conic) * u - radius;
  const double steepness = 2 * std::hypot(at.r, normal);
  return {(at.r * at.r + (1 + conic) * u * u - 2 * radius * u) / steepness, -2 * u / steepness,
          -2 * normal / steepness};
}

/// 3.2.1: radius and pole of one isofocus surface by least squares of the distances, Gauss-Newton;
/// the conic constant k is held. The start is the linear fit of r^2 + (1 + k) z^2 = 2 A z - B,
/// where A = R + (1 + k) z0 and B = (1 + k) z0^2 + 2 R z0.
/// Least squares of r^2 alone would weigh far points more and is biased, so it is the start only.
/// An eleventh pass serves the residual of the last step.
IsofocusSurface fit_surface(const std::vector<Plane>& points, double conic, double focus) {
  constexpr int kSteps = 10;
  const auto count = static_cast<Eigen::Index>(points.size());
  Eigen::MatrixX2d jacobian(count, 2);
  Eigen::VectorXd off(count);
  for (Eigen::Index i = 0; i < count; ++i) {
    jacobian.row(i) << 2 * points[i].z, -1;
    off[i] = points[i].r * points[i].r + (1 + conic) * points[i].z * points[i].z;
  }
  const Eigen::Vector2d ab = detail::least_squares(jacobian, off);
  // z0 from (1 + k) z0^2 - 2 A z0 + B = 0, the smaller root without cancellation; then R = A - (1 +
  // k) z0.
  const double root = std::sqrt(std::max(ab[0] * ab[0] - (1 + conic) * ab[1], 0.0));
  const double start = ab[1] / (ab[0] + (ab[0] < 0 ? -root : root));
  Eigen::Vector2d p(ab[0] - (1 + conic) * start, start);
  IsofocusSurface made;
  for (int step = 0; step <= kSteps; ++step) {
    for (Eigen::Index i = 0; i < count; ++i) {
      const Distance from = distance(p[0], conic, p[1], points[i]);
      off[i] = -from.value;
      jacobian.row(i) << from.per_radius, from.per_pole;
    }
    // The residual is that of the parameters before this pass' step.
    made = {focus, p[0], p[1], off.cwiseAbs().maxCoeff()};
    p += detail::least_squares(jacobian, off);
  }
  return made;
}

/// 3.2.1: slope and intercept of one isopixel curve, by the normal equations of r = a + s z.
/// The residual is across the axis, where a pixel's offset acts.
IsopixelCurve fit_line(const std::vector<Plane>& points, double height) {
  double n = 0;
  double z = 0;
  double r = 0;
  double zz = 0;
  double zr = 0;
  for (const Plane& at : points) n += 1, z += at.z, r += at.r, zz += at.z * at.z, zr += at.z * at.r;
  IsopixelCurve made;
  made.height = height;
  made.slope = (n * zr - z * r) / (n * zz - z * z);
  made.intercept = (r - made.slope * z) / n;
  for (const Plane& at : points) {
    made.max_residual =
        std::max(made.max_residual, std::abs(at.r - made.intercept - made.slope * at.z));
  }
  return made;
}

/// 3.2.1: a polynomial of third order for each parameter.
/// Throws std::invalid_argument naming the map with fewer points than a residual needs. The fit
/// runs in x / largest x.
Cubic fit_cubic(const std::vector<double>& x, const std::vector<double>& y) {
  const auto count = static_cast<Eigen::Index>(x.size());
  if (count < kFewest) throw std::invalid_argument("map: too small for the thesis' cubics");
  Cubic made;
  made.from = *std::min_element(x.begin(), x.end());
  made.to = *std::max_element(x.begin(), x.end());
  Eigen::MatrixX4d powers(count, 4);
  for (Eigen::Index i = 0; i < count; ++i) {
    const double t = x[i] / made.to;  // scaled, for the condition of the fit
    powers.row(i) << 1, t, t * t, t * t * t;
  }
  const Eigen::Vector4d fit =
      detail::least_squares(powers, Eigen::Map<const Eigen::VectorXd>(y.data(), count));
  for (int k = 0; k < 4; ++k) made.c[k] = fit[k] / std::pow(made.to, k);
  for (Eigen::Index i = 0; i < count; ++i)
    made.max_residual = std::max(made.max_residual, std::abs(made(x[i]) - y[i]));
  return made;
}

/// One parameter's cubic; the columns are named by pointers to members.
template <class Row>
Cubic fit_column(const std::vector<Row>& rows, double Row::*x, double Row::*y) {
  std::vector<double> xs;
  std::vector<double> ys;
  for (const Row& row : rows) xs.push_back(row.*x), ys.push_back(row.*y);
  return fit_cubic(xs, ys);
}

}  // namespace

void ThesisSettings::check() const {
  detail::require_finite(conic, "conic");
  detail::require_at_least(surfaces, kFewest, "surfaces");
  detail::require_at_least(curves, kFewest, "curves");
  detail::require_at_least(samples, kFewest, "samples");
}

/// 3.2.1 and figure 3.6: surfaces at equal steps of d_ls from the retina's image to the deepest
/// point's, curves at equal steps of d_op, then a cubic for each of the four parameters.
/// What the map cannot draw is left out, so `from` and `to` of the cubics are the ends of what was
/// fitted and not of what was asked.
ThesisCurves fit_thesis_curves(const WideAngleMap& map, const ThesisSettings& settings) {
  settings.check();
  ThesisCurves made;
  made.conic = settings.conic;
  const auto retina = map.at({0, 0});
  const auto deepest = map.at({0, map.max_depth()});
  const auto edge = map.at({map.max_angle(), 0});
  if (!(retina && deepest && edge)) throw std::invalid_argument("map: has no value at its corners");
  for (int i = 0; i < settings.surfaces; ++i) {
    const double focus =
        retina->focus + (deepest->focus - retina->focus) * i / (settings.surfaces - 1);
    const auto points = isofocus_points(map, focus, settings.samples);
    if (points.size() >= kFewest)
      made.surfaces.push_back(fit_surface(points, settings.conic, focus));
  }
  for (int i = 1; i <= settings.curves; ++i) {
    const double height = std::abs(edge->height) * i / settings.curves;
    const auto points = isopixel_points(map, height, settings.samples);
    if (points.size() >= kFewest) made.curves.push_back(fit_line(points, height));
  }
  made.radius = fit_column(made.surfaces, &IsofocusSurface::focus, &IsofocusSurface::radius);
  made.pole = fit_column(made.surfaces, &IsofocusSurface::focus, &IsofocusSurface::pole);
  made.slope = fit_column(made.curves, &IsopixelCurve::height, &IsopixelCurve::slope);
  made.intercept = fit_column(made.curves, &IsopixelCurve::height, &IsopixelCurve::intercept);
  return made;
}

/// Nothing beyond the ends: outside, the cubics follow no surface of this eye.
std::optional<WideAngleMap::Plane> ThesisCurves::point(double focus, double height) const {
  // On the axis the thesis' cubics have constant terms; they are used as they are. A little outside
  // the first and last curve is still within the pixel that the curve stands for.
  if (!pole.covers(focus) || !(height >= 0 && height <= slope.to)) return std::nullopt;
  return extrapolated_point(focus, height);
}

/// 4.1: the position is the intersection of the isopixel curve with the isofocus surface.
/// `pole_shift` (m, along the axis) is what a calibration on the retina changes (4.3: only the
/// intersection with the axis).
std::optional<WideAngleMap::Plane> ThesisCurves::extrapolated_point(double focus, double height,
                                                                    double pole_shift) const {
  const double R = radius(focus);
  const double z0 = pole(focus) + pole_shift;
  const double a = intercept(height);
  const double s = slope(height);
  // (a + s z)^2 = 2 R (z - z0) - (1 + k) (z - z0)^2, with u = z - z0 and r0 = a + s z0
  const double r0 = a + s * z0;
  const double A = s * s + 1 + conic;
  const double B = r0 * s - R;
  const double C = r0 * r0;
  const double discriminant = B * B - A * C;
  if (!(discriminant >= 0)) return std::nullopt;
  // The crossing near the pole, without cancellation, also where the surface is curved away from
  // the eye's front.
  const double u = C / (-B + std::copysign(std::sqrt(discriminant), -B));
  return WideAngleMap::Plane{r0 + s * u, z0 + u};
}

}  // namespace vitreo::optics
