// Camera calibration: scale, center and rotation from points in the aerial image's plane, or in any
// plane parallel to it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/pose/pose.h"
#include "optics/projection/single_viewpoint.h"

#include <Eigen/Core>

#include <optional>
#include <span>

namespace vitreo::optics {

/// A point of the plane (m, x to the right and y up in the upright world; m is inverted as
/// ImageScale has it) and the pixel that shows it.
struct PointPair {
  Eigen::Vector2d m;         // m
  Eigen::Vector2d pixel_px;  // px
};

struct CameraFit {
  ImageScale image;     // scale and center
  double rotation = 0;  // rad, of the image against ImageScale's own axes, from +u towards +v
  double rms_residual_px = 0;
  double max_residual_px = 0;
  double scale_sigma = 0;     // m per pixel, one sigma from the residuals; 0 without spare points
  double rotation_sigma = 0;  // rad
  Eigen::Vector2d center_sigma_px{0, 0};
  Eigen::Vector2d pixel_from_m(const Eigen::Vector2d& m) const;
  Eigen::Vector2d m_from_pixel(const Eigen::Vector2d& pixel_px) const;
};

/// Least squares in the image, closed form. Throws std::invalid_argument naming `pairs`: fewer than
/// two, not finite, all at one position, or mirrored.
CameraFit fit_camera(std::span<const PointPair> pairs);

/// Correction of an error of size against depth by one observation of the robot at a known
/// position: on the retina.
enum class PoseCorrection {
  image_scale,      // the image is taken to be larger or smaller than thought
  additive_offset,  // the depth is taken to be off by as much everywhere
};

struct PoseCalibration {
  double image_scale = 1;                            // ImageScale.pixel times this
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();  // m, added to positions
  double residual = 0;                               // m, left at the known point along z
  /// One sigma by the look's own noise and that of the known height: relative of the scale, or m
  /// along z of the offset. What eye and bench do beside it: optics/chain/chain_doubt.h.
  double sigma = 0;
  PoseSettings applied(PoseSettings settings) const;
  Eigen::Vector3d applied(const Eigen::Vector3d& position_in_eye) const {
    return position_in_eye + offset;
  }
};

/// What is uncertain of a look at a known height.
struct LookNoise {
  EllipseCovariance covariance = EllipseCovariance::Zero();  // of the observed ellipse
  double known_z_sigma = 0;                                  // m
};

/// `observed`: the robot's ellipse when it lay at the known height `known_z` (m, its center in the
/// eye frame), with its axis along `axis_in_eye`. Throws std::invalid_argument naming `observed`
/// when no scale within 0.7 to 1.4 explains it, or the localizer answers nothing.
PoseCalibration calibrate_pose(const PoseSettings& settings, const EllipseVector& observed,
                               const Eigen::Vector3d& axis_in_eye, double known_z,
                               PoseCorrection correction = PoseCorrection::image_scale,
                               const LookNoise& noise = {});

}  // namespace vitreo::optics
