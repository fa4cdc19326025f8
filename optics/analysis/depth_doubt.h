// Depth doubt: systematic uncertainty of a position that one camera finds through the eye by the
// size of the robot's image.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/system/tolerance.h"

#include <Eigen/Core>

#include <optional>
#include <vector>

namespace vitreo::optics {

/// What one uncertain parameter of the eye changes by one sigma of it, to first order.
struct ViewpointShift {
  double viewpoint = 0;  // m, along the axis
  double scale = 0;      // relative, of the focal length: of every image
};

/// One for each uncertain parameter that the prescription has: its front focus is where the lines
/// of sight of a telecentric microscope meet.
std::vector<ViewpointShift> viewpoint_shifts(const Prescription& prescription,
                                             const std::vector<Uncertainty>& uncertainties);

/// A body at z shows as large as s f / (v - z), s its size, f the focal length, v the viewpoint. A
/// loop that believes others finds the depth where its own model shows the same.
struct DepthDoubt {
  double viewpoint = 0;             // m, v, eye frame
  double scale = 0;                 // relative sigma of s: size, outline, pixel
  std::vector<ViewpointShift> eye;  // nothing: the eye is known
  /// m, eye frame: z of the observation by which the image's scale was calibrated. There the depth
  /// is right, whatever s, f and v are.
  std::optional<double> calibrated_at;
  double residual = 0;  // relative sigma of s that is left after the calibration
  double aside = 0;     // m, sigma across the axis, x and y: of what moves the picture as a whole
  void check() const;   // throws std::invalid_argument naming the parameter
  /// m^2 at a point of the eye frame: along the line of sight, and across it by the scale.
  Eigen::Matrix3d covariance(const Eigen::Vector3d& point_in_eye) const;
  double sigma_z(double z) const;  // m
};

}  // namespace vitreo::optics
