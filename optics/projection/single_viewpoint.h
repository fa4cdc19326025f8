// The thesis' projection through the eye's optics: isopixel curves simplified to meet in one
// viewpoint, (5.2) to (5.11).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/rays/observer.h"

#include <Eigen/Core>

#include <array>
#include <optional>

namespace vitreo::optics {

/// Fitted to the chain's own chief rays. Eye frame, lengths in m.
struct SingleViewpoint {
  double viewpoint = 0;  // z of p_0, the median of the curves' intersections with the axis
  std::array<double, 4> slope_from_m{};  // a, b, c, d of (5.2): slope = a|m|^3 + b|m|^2 + c|m| + d
  double max_m = 0;                      // m; the fit holds for |m| up to here
  double max_z = 0;  // m; and for points from the retina's vertex, z = 0, up to here: the vitreous
  double max_residual = 0;  // of the fitted slope, for the record
  Eigen::Vector2d axis_m{
      0, 0};  // m; where the eye's axis falls in the aerial image: |m| is counted from there
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

}  // namespace vitreo::optics
