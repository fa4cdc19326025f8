// SPDX-License-Identifier: Apache-2.0
#include "optics/projection/single_viewpoint.h"

#include "optics/numerics/linear.h"
#include "optics/numerics/preconditions.h"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>
#include <vector>

namespace vitreo::optics {
namespace {

/// A straight isopixel curve in the meridional plane: distance from the axis = at_retina + slope *
/// z.
struct Curve {
  double m = 0;
  double at_retina = 0;
  double slope = 0;
};

/// Traced isopixel curves at equal steps of |m| from the axis outwards, up to the first lost ray.
/// Rays that come through again beyond a lost one are left out, as they belong to no connected
/// image.
std::vector<Curve> trace_curves(const System& system, const Microscope& centered, double max_m,
                                int samples) {
  std::vector<Curve> curves;
  for (int i = 1; i <= samples; ++i) {
    const double m = max_m * i / samples;
    const std::optional<Ray> line = isopixel_line(system, centered, {m, 0});
    if (!line) break;
    const double slope = line->direction.x() / line->direction.z();
    curves.push_back({m, line->origin.x() - slope * line->origin.z(), slope});
  }
  return curves;
}

/// p_0 of thesis 5.2: the median of the curves' intersections p_c with the optical axis.
/// With an even number of curves the upper of the two in the middle.
double median_intersection_with_axis(const std::vector<Curve>& curves) {
  std::vector<double> z;
  z.reserve(curves.size());
  for (const Curve& curve : curves) z.push_back(-curve.at_retina / curve.slope);
  const auto middle = z.begin() + static_cast<std::ptrdiff_t>(z.size() / 2);
  std::nth_element(z.begin(), middle, z.end());
  return *middle;
}

/// The slope of the line through the viewpoint that is nearest to the curve between two depths: the
/// minimum over lambda of the integral of (at_retina + slope z - lambda (z - viewpoint))^2.
/// Depths are z in m. Distances across the axis count, as those are what a projection errs by.
double slope_through(double viewpoint, const Curve& curve, double from_z, double to_z) {
  // With t = z - viewpoint: minimize the integral of (e + (slope - lambda) t)^2, e the curve at the
  // viewpoint; lambda = slope + e * integral of t / integral of t^2.
  const double at_viewpoint = curve.at_retina + curve.slope * viewpoint;
  const double t0 = from_z - viewpoint;
  const double t1 = to_z - viewpoint;
  const double first = (t1 * t1 - t0 * t0) / 2;
  const double second = (t1 * t1 * t1 - t0 * t0 * t0) / 3;
  return curve.slope + at_viewpoint * first / second;
}

/// (5.2) by least squares, d = 0.
/// d = 0, as the line of m = 0 is the axis by symmetry; as printed, (5.2) has it free.
void fit_slopes(const std::vector<Curve>& curves, double from_z, double to_z,
                SingleViewpoint& view) {
  const auto count = static_cast<Eigen::Index>(curves.size());
  Eigen::MatrixX3d powers(count, 3);
  Eigen::VectorXd slopes(count);
  for (Eigen::Index i = 0; i < count; ++i) {
    const double x = curves[i].m / view.max_m;  // scaled, for the condition of the fit
    powers.row(i) << x * x * x, x * x, x;
    slopes[i] = slope_through(view.viewpoint, curves[i], from_z, to_z);
  }
  const Eigen::Vector3d fit = detail::least_squares(powers, slopes);
  view.slope_from_m = {fit[0] / std::pow(view.max_m, 3), fit[1] / std::pow(view.max_m, 2),
                       fit[2] / view.max_m, 0};
  view.max_residual = (powers * fit - slopes).cwiseAbs().maxCoeff();
}

/// (5.5) to (5.9), the one real root where D^2 >= 0 (Cardano). Where D^2 < 0 there are three, which
/// take cosines instead of cube roots (Viete); the one nearest the middle of the range is meant.
/// The thesis prints the case of one real root alone.
double root_by_formula(const std::array<double, 4>& cubic, double slope, double max_m) {
  const auto& [a, b, c, d] = cubic;
  const double q = b * b - 3 * a * c;
  const double A = 2 * b * b * b - 9 * a * b * c + 27 * a * a * (d - slope);
  const double D2 = A * A - 4 * q * q * q;
  if (D2 >= 0) {
    const double D = std::sqrt(D2);
    return -(b + std::cbrt((A + D) / 2) + std::cbrt((A - D) / 2)) / (3 * a);
  }
  const double angle = std::acos(std::clamp(A / (2 * q * std::sqrt(q)), -1.0, 1.0));
  double nearest = std::numeric_limits<double>::infinity();
  for (int k = 0; k < 3; ++k) {
    const double turned = (angle + 2 * std::numbers::pi * k) / 3;
    const double root = -(b + 2 * std::sqrt(q) * std::cos(turned)) / (3 * a);
    if (std::abs(root - max_m / 2) < std::abs(nearest - max_m / 2)) nearest = root;
  }
  return nearest;
}

}  // namespace

/// The closed form gives the start, Newton's method the digits; what does not satisfy (5.2) within
/// the range is no answer.
/// `slope` is the tangent of (5.4), not negative. Six steps of Newton's method are plenty for a
/// start that is right to some digits.
std::optional<double> detail::height_from_slope(const SingleViewpoint& view, double slope) {
  // of the linear term: below this the formula divides nothing by nothing
  constexpr double kSmall = 1e-4;
  constexpr double kRounding = 1e-9;  // of max_m
  const auto& [a, b, c, d] = view.slope_from_m;
  const bool nearly_linear = std::abs(a) * view.max_m * view.max_m < kSmall * std::abs(c);
  double h =
      nearly_linear ? (slope - d) / c : root_by_formula(view.slope_from_m, slope, view.max_m);
  // The formula cancels where a is small: Newton restores the digits.
  for (int i = 0; i < 6; ++i) {
    const double step = (slope - slope_at(view, h)) / slope_derivative_at(view, h);
    h += step;
    if (std::abs(step) < 1e-12 * view.max_m) break;
  }
  const double slack = kRounding * view.max_m;
  if (!(h >= -slack && h <= view.max_m + slack)) return std::nullopt;
  if (!(std::abs(slope_at(view, h) - slope) < kRounding)) return std::nullopt;
  return h;
}

/// Monotony of (5.2), "one-to-one" in the thesis, is tested at 65 heights.
/// Throws std::invalid_argument naming the value that (5.3) to (5.11) cannot do with.
void SingleViewpoint::check() const {
  constexpr int kSteps = 64;
  const bool finite = std::all_of(slope_from_m.begin(), slope_from_m.end(),
                                  [](double x) { return std::isfinite(x); });
  detail::require_positive(viewpoint, "viewpoint");
  if (!finite) throw std::invalid_argument("slope_from_m: must be finite");
  detail::require_positive(max_m, "max_m");
  detail::require(max_z > 0 && max_z < viewpoint, "max_z: must lie between 0 and the viewpoint");
  detail::require(axis_m.allFinite(), "axis_m: must be finite");
  for (int i = 0; i <= kSteps; ++i) {
    detail::require(detail::slope_derivative_at(*this, max_m * i / kSteps) > 0,
                    "slope_from_m: does not grow with |m| up to max_m");
  }
}

/// (5.3) to (5.11), for 0 <= z <= max_z and heights up to max_m.
std::optional<Eigen::Vector2d> SingleViewpoint::project(const Eigen::Vector3d& point_in_eye) const {
  detail::require(point_in_eye.allFinite(), "point_in_eye: must be finite");
  if (!(point_in_eye.z() >= 0 && point_in_eye.z() <= max_z)) return std::nullopt;
  Eigen::Vector2d m;
  const Eigen::Vector3d from_viewpoint = point_in_eye - Eigen::Vector3d(0, 0, viewpoint);  // (5.3)
  if (!detail::project(*this, from_viewpoint, m)) return std::nullopt;
  return m;
}

/// Thesis 5.2: curves, viewpoint as the median of their intersections with the axis, then slopes
/// through that viewpoint.
/// The viewpoint lies on the eye's axis, so a tilt has no place in this model; a decentering only
/// moves where m counts from (axis_m). Throws std::invalid_argument naming max_m, the samples or
/// the depths.
SingleViewpoint fit_single_viewpoint(const System& system, const Microscope& microscope,
                                     double max_m, int samples, double fit_from_z,
                                     double fit_to_z) {
  constexpr int kFewest = 8;
  constexpr double kNearViewpoint = 0.95;  // beyond, the image of a point grows without bound
  system.check();
  microscope.check();
  detail::require_positive(max_m, "max_m");
  detail::require_at_least(samples, kFewest, "samples");
  detail::require(std::isfinite(fit_from_z) && std::isfinite(fit_to_z) && fit_from_z < fit_to_z,
                  "fit_to_z: must be larger than fit_from_z");
  Microscope centered = microscope;
  centered.decenter.setZero();
  centered.tilt.setZero();
  const std::vector<Curve> curves = trace_curves(system, centered, max_m, samples);
  if (2 * curves.size() < static_cast<std::size_t>(samples)) {
    throw std::invalid_argument("max_m: more than half of the rays up to it are lost");
  }
  SingleViewpoint view;
  view.max_m = curves.back().m;
  view.axis_m = -microscope.decenter;
  view.viewpoint = median_intersection_with_axis(curves);
  view.max_z = std::min(system.vertex(2), kNearViewpoint * view.viewpoint);
  fit_slopes(curves, fit_from_z, fit_to_z, view);
  view.check();
  return view;
}

void ImageScale::check() const {
  detail::require_positive(pixel, "pixel");
  detail::require(center_px.allFinite(), "center_px: must be finite");
}

}  // namespace vitreo::optics
