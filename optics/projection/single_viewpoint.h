// Single-viewpoint projection, the thesis' projection through the eye's optics: isopixel curves
// simplified to meet in one viewpoint, (5.2) to (5.11); the microscope's K, (5.12).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/numerics/scalar.h"
#include "optics/rays/observer.h"

#include <Eigen/Core>

#include <array>
#include <cmath>
#include <optional>

namespace vitreo::optics {

/// Fitted to the chain's own chief rays. Eye frame, lengths in m.
struct SingleViewpoint {
  double viewpoint = 0;  // z of p_0, the median of the curves' intersections with the axis
  std::array<double, 4> slope_from_m{};  // a, b, c, d of (5.2): slope = a|m|^3 + b|m|^2 + c|m| + d
  double max_m = 0;                      // m; the fit holds for |m| up to here
  double max_z = 0;  // m; and for points from the retina's vertex, z = 0, up to here: the vitreous
  double max_residual = 0;  // of the fitted slope, for the record
  // m; where the eye's axis falls in the aerial image: |m| is counted from there
  Eigen::Vector2d axis_m{0, 0};
  /// The aerial-image point m of an intraocular point, or nothing outside the fit. (5.3) to (5.11),
  /// with |m| from the real root. Throws std::invalid_argument when the point is not finite.
  std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& point_in_eye) const;
  /// Throws std::invalid_argument naming the parameter; slopes that do not grow with |m| leave the
  /// projection ambiguous.
  void check() const;
};

/// Fits viewpoint and slopes to the isopixel lines at `samples` heights up to max_m, by least
/// squares of their distance over the vitreous from `fit_from_z` to `fit_to_z` (m, where the robot
/// works). d of (5.2) is held at zero: by symmetry the axis is seen at |m| = 0, and any other d
/// would tear the image there. When the outermost rays are lost, the fit's max_m is smaller than
/// asked. A decentered microscope shifts the image (exact when telecentric); its tilt is not in
/// this model. Throws std::invalid_argument for bad arguments, and when more than half of the rays
/// are lost.
SingleViewpoint fit_single_viewpoint(const System& system, const Microscope& microscope,
                                     double max_m, int samples = 41, double fit_from_z = 2e-3,
                                     double fit_to_z = 8e-3);

/// The microscope's K of (5.12): pixel from aerial image. The aerial image is inverted; both signs
/// are chosen so that world +x is to the right (+u) and world +y is up (-v) in the image.
struct ImageScale {
  double pixel = 14.3e-6;           // m of aerial image per pixel
  Eigen::Vector2d center_px{0, 0};  // where m = 0 falls
  Eigen::Vector2d pixel_from_m(const Eigen::Vector2d& m) const {
    return {center_px.x() - m.x() / pixel, center_px.y() + m.y() / pixel};
  }
  Eigen::Vector2d m_from_pixel(const Eigen::Vector2d& u) const {
    return {(center_px.x() - u.x()) * pixel, (u.y() - center_px.y()) * pixel};
  }
  void check() const;  // throws std::invalid_argument naming the parameter
};

namespace detail {

/// Slope of the isopixel curve at |m| = h, (5.2), and its derivative.
inline double slope_at(const SingleViewpoint& view, double h) {
  const auto& [a, b, c, d] = view.slope_from_m;
  return ((a * h + b) * h + c) * h + d;
}
inline double slope_derivative_at(const SingleViewpoint& view, double h) {
  const auto& [a, b, c, d] = view.slope_from_m;
  return (3 * a * h + 2 * b) * h + c;
}

/// The real root |m| of (5.2) within [0, max_m]; nothing when there is none.
std::optional<double> height_from_slope(const SingleViewpoint& view, double slope);

/// The aerial-image point of `from_viewpoint` = X - p_0, (5.3). False when the line of sight is
/// outside the fit. The thesis' tan(arccos) and 1/sqrt(1 + tan^2) lose the quadrant; lengths and
/// unit vectors keep it.
template <class T>
bool project(const SingleViewpoint& view, const Vector3<T>& from_viewpoint, Vector2<T>& m) {
  using std::sqrt;
  constexpr double kNearest = 1e-4;  // m; a point this close to the viewpoint has no line of sight
  // slope; there the azimuth is undefined and the cubic its tangent
  constexpr double kOnAxis = 1e-12;
  const T depth = -from_viewpoint.z();
  if (!(depth > kNearest)) return false;
  const Vector2<T> across = from_viewpoint.template head<2>() / depth;
  const T slope2 = across.squaredNorm();
  if (slope2 < kOnAxis * kOnAxis) {
    m = -across / slope_derivative_at(view, 0) + view.axis_m;
    return true;
  }
  const T slope = sqrt(slope2);  // (5.4)
  const std::optional<double> height = height_from_slope(view, scalar(slope));
  if (!height) return false;
  // One Newton step in T: changes nothing in the value and gives the derivative of the implicit
  // root.
  const T h = *height + (slope - slope_at(view, *height)) / slope_derivative_at(view, *height);
  m = across * (-h / slope) + view.axis_m;  // (5.10), (5.11): azimuth phi + pi
  return true;
}

}  // namespace detail
}  // namespace vitreo::optics
