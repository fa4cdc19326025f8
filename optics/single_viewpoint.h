// The thesis' projection through the eye's optics: isopixel curves simplified to meet in one viewpoint, (5.2) to (5.11).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>

#include <Eigen/Core>

#include "optics/observer.h"

namespace vitreo::optics {

/// Fitted to the chain's own chief rays. Eye frame, lengths in m.
struct SingleViewpoint {
  double viewpoint = 0;                    // z of p_0, the median of the curves' intersections with the axis
  std::array<double, 4> slope_from_m{};    // a, b, c, d of (5.2): slope = a|m|^3 + b|m|^2 + c|m| + d
  double max_m = 0;                        // m; the fit holds for |m| up to here
  double max_residual = 0;                 // of the fitted slope, for the record
  /// The aerial-image point m of an intraocular point, or nothing outside the fit. (5.3) to (5.11), with |m| from the real root.
  std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& point_in_eye) const;
};

/// Fits viewpoint and slopes to the isopixel lines at `samples` heights up to max_m. Throws std::invalid_argument when too
/// many of the rays are lost.
SingleViewpoint fit_single_viewpoint(const System& system, const Microscope& microscope, double max_m, int samples = 41);

/// The microscope's K of (5.12): pixel from aerial image. The aerial image is inverted; both signs are chosen so that world
/// +x is to the right (+u) and world +y is up (-v) in the image.
struct ImageScale {
  double pixel = 14.3e-6;                    // m of aerial image per pixel
  Eigen::Vector2d centre_px{0, 0};           // where m = 0 falls
  Eigen::Vector2d pixel_from_m(const Eigen::Vector2d& m) const { return {centre_px.x() - m.x() / pixel, centre_px.y() + m.y() / pixel}; }
  Eigen::Vector2d m_from_pixel(const Eigen::Vector2d& u) const { return {(centre_px.x() - u.x()) * pixel, (u.y() - centre_px.y()) * pixel}; }
};

}  // namespace vitreo::optics
