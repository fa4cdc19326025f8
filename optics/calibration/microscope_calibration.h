// Microscope calibration: pupil, tilt, scale, center and rotation from a target that is seen at
// several heights without an eye.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <span>

namespace vitreo::optics {

/// A point of the target where its stage put it (m; z along the light from the plane in focus, x to
/// the right and y up in the image) and the pixel that shows it.
struct TargetPoint {
  Eigen::Vector3d position;
  Eigen::Vector2d pixel_px;
};

/// One sigma beside each number, from the residuals.
struct MicroscopeFit {
  double pixel = 0;  // m of the plane z = 0
  double pixel_sigma = 0;
  double pupil_power = 0;  // 1/m, 1 / the pupil's distance from that plane; 0: telecentric
  double pupil_power_sigma = 0;
  Eigen::Vector2d tilt{0, 0};  // rad, about x then y, as Microscope has it
  Eigen::Vector2d tilt_sigma{0, 0};
  Eigen::Vector2d center_px{0, 0};  // that shows the axis' point of that plane
  Eigen::Vector2d center_sigma_px{0, 0};
  double rotation = 0;  // rad, of the image, from +u towards +v; pi where it is inverted
  double rotation_sigma = 0;
  double rms_residual_px = 0;
  double max_residual_px = 0;
};

/// The chief ray of an image point m runs from R (m, 0) along R (-power m, 1), R the tilt, and its
/// pixel is center + turn (m_x, -m_y) / pixel: least squares in the image. Throws
/// std::invalid_argument naming `points`: fewer than five, not finite, all at one height (pupil and
/// tilt show only in how the image changes with height) or in one place, mirrored, or explained by
/// no microscope.
MicroscopeFit fit_microscope(std::span<const TargetPoint> points);

}  // namespace vitreo::optics
