// Viewing system: a microscope over the aerial image, its entrance pupil and the chief rays of the
// whole chain, from the pixel back into the vitreous.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/rays/trace.h"
#include "optics/system/system.h"

#include <Eigen/Core>

#include <limits>
#include <optional>

namespace vitreo::optics {

/// A microscope over the aerial image; its small aperture is the stop of the chain. Points of its
/// object plane are given by m (in m; x and y of the eye frame when not tilted, from the
/// microscope's own axis).
struct Microscope {
  double numerical_aperture = 0.01;
  double focus = 12.3e-3;  // m, from the last vertex of the system to the plane in focus
  // m, focus plane to its entrance pupil; infinite: telecentric; negative: the pupil lies on the
  // eye's side
  double pupil_distance = std::numeric_limits<double>::infinity();
  Eigen::Vector2d decenter{0, 0};  // m, its axis against the eye's, in the focus plane
  // rad, its axis turned about x, then about y, where it meets the focus plane
  Eigen::Vector2d tilt{0, 0};
  void check() const;  // throws std::invalid_argument naming the parameter
};

/// The microscope's chief ray through the point m of its object plane, in air behind the eye, going
/// towards +z; eye frame, its origin in the object plane. System and microscope are taken as
/// checked. Throws std::invalid_argument when m is not finite.
Ray chief_ray_in_air(const System& system, const Microscope& microscope, const Eigen::Vector2d& m);

/// The same ray followed back into the vitreous: the isopixel line of m (thesis 3.3, traced, not
/// fitted). It goes towards +z from surface 2, where its origin lies; the line holds in the whole
/// vitreous; eye frame. Nothing when the ray is lost on its way or blocked by the stop.
std::optional<Ray> isopixel_line(const System& system, const Microscope& microscope,
                                 const Eigen::Vector2d& m);

}  // namespace vitreo::optics
