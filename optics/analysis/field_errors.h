// Localization errors of an uncertain eye over the whole field: by focus (figures 4.2, 4.5, 4.6)
// and by pose (table 5.2). Functions for one_at_a_time, statistics and variance_attribution.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/analysis/error_analysis.h"
#include "optics/pose/pose.h"

#include <numbers>

namespace vitreo::optics {

/// Statistic of the errors over the field.
enum class ErrorMeasure { max, mean };

struct FieldErrorOptions {
  double max_angle = 35 * std::numbers::pi / 180;  // rad, at the stop's center
  double depth_to = 8e-3;                          // m; depths from the retina to here
  // of the grid, at least 3
  int angles = 8;
  int depths = 11;
  // of each bundle: disc_samples
  int rings = 6;
  int arms = 12;
  double focus_error = 0;   // m, by which the sensor is misplaced, the worse of both signs (4.2e)
  bool calibrated = false;  // biometrically, on the eye's own retina
  double retinal_depth_error = 0;  // m, of that calibration; the worse of both signs counts
  BiometricMethod method = BiometricMethod::sensor_shift;
  ErrorMeasure measure = ErrorMeasure::max;
  void check() const;  // throws std::invalid_argument naming the option
};

/// Distance (m) between points of the field and their positions as located with the assumed eye
/// `believed`: images of traced bundles of the true eye, taken back along the believed thesis'
/// curves, their cubics carried on beyond their ends. Calibration moves the isofocus surfaces along
/// the axis by what it changes in the on-axis law (4.10) to (4.12). Points whose bundles are lost,
/// or whose curves do not cross within three vitreous lengths of the retina, do not count; when
/// they are more than a quarter, there is no answer. Throws std::invalid_argument for bad options,
/// or when the believed eye has no map.
EyeError field_error(const Prescription& believed, const FieldErrorOptions& options = {});

struct PoseErrorOptions {
  Microscope microscope;  // telecentric by default: chapters 5 and 6 take it as orthographic
  double max_m = 9.9e-3;  // m, of the aerial image
  Spheroid robot{0.5e-3, 0.5e-3};                  // the sphere of 1 mm of section 5.4
  double max_angle = 35 * std::numbers::pi / 180;  // rad, at the stop's center
  // m before the retina
  double depth_from = 1e-3;
  double depth_to = 8e-3;
  // of the grid, at least 3
  int angles = 8;
  int depths = 8;
  /// Isopixel lines of both eyes as the chains have them, not the thesis' single viewpoint (5.2) to
  /// (5.11).
  bool exact = false;
  /// The image scale is corrected by one observation of the robot `depth_from` before the retina on
  /// the axis, its position known to retinal_depth_error.
  bool calibrated = false;
  double retinal_depth_error = 0;             // m; the worse of both signs counts
  ErrorMeasure measure = ErrorMeasure::mean;  // over the whole field, as table 5.2
  void check() const;                         // throws std::invalid_argument naming the option
};

/// The same for localization by pose (5.15): the silhouette through the true eye, located with the
/// assumed one.
EyeError pose_error(const Prescription& believed, const PoseErrorOptions& options = {});

}  // namespace vitreo::optics
