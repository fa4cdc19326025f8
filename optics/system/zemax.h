// Import of Zemax lens files (.zmx): sequential; standard, even aspheric and biconic surfaces;
// coordinate breaks.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/system/prescriptions.h"

#include <Eigen/Core>

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace vitreo::optics {

/// A coordinate break: what follows is moved by `decenter` and turned by Rx Ry Rz of `tilt`; with
/// `tilt_first` (order flag not 0) turned by Rz Ry Rx, then moved in the turned axes.
struct ZemaxBreak {
  Eigen::Vector2d decenter{0, 0};  // m
  Eigen::Vector3d tilt{0, 0, 0};   // rad
  bool tilt_first = false;
};

/// The contents of a file, in its own order: the first surface is the object, the last the image.
/// SI; the last four aspheric coefficients of the format (r^2 and r^12 to r^16) must be zero.
/// Indices are those of the d line (587.6 nm): dispersion is not imported.
struct ZemaxFile {
  std::string title;
  std::vector<Surface> surfaces;      // infinite thickness: an object at infinity
  std::vector<std::string> comments;  // one per surface, often empty
  // one per surface: a break is no surface, but has a number and a thickness as one
  std::vector<std::optional<ZemaxBreak>> breaks;
  int stop = 0;  // number of the stop's surface as in the file, from 0; 0: none
  std::optional<double> stop_radius;              // m: the stop surface's DIAM
  std::optional<double> entrance_pupil_diameter;  // m
  std::vector<double> wavelengths;                // m
  int primary_wavelength = 0;                     // index into `wavelengths`, from 0
};

/// Reads the bytes of a file: UTF-8, or UTF-16 with a byte order mark. Throws std::invalid_argument
/// that begins with "line N: OPERAND" for everything that would change the light and is not
/// supported: other surface types, mirrors, unknown glasses, apertures that are not centered
/// circles, several configurations, non-sequential files.
ZemaxFile parse_zemax(std::string_view bytes);

enum class ZemaxDirection {
  object_is_retina,  // light in the file goes the way it does here: out of the eye
  image_is_retina,  // it goes into the eye, as eyes are usually modeled: everything is turned round
};

/// A prescription for tracing: from the retina, whose frame is the eye frame, to the last
/// refracting surface; breaks have become decenters and tilts. Surfaces are called by their number.
/// The stop's radius is the file's, or follows from the entrance pupil in first order; no stop when
/// there is neither. Throws std::invalid_argument when what should be the retina is at infinity, or
/// the system is unsound.
Prescription prescription_from_zemax(const ZemaxFile& file, ZemaxDirection direction);

}  // namespace vitreo::optics
