// Parameters of the whole viewing chain (eye, retina, condensing lens, microscope, robot) with what
// is known of each beforehand.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/pose/pose_settings.h"
#include "optics/rays/observer.h"
#include "optics/system/tolerance.h"

#include <Eigen/Core>

#include <string>
#include <vector>

namespace vitreo::optics {

/// The chain as it is believed. The frame of all positions is the eye frame of this nominal chain:
/// it stays where it is, whatever the parameters.
struct NominalChain {
  Prescription
      prescription;  // eye and condensing lens; surfaces named "lens..." are the eye's lens
  Microscope microscope;
  ImageScale image;
  Spheroid robot;
  /// Thickness over width of the two crossed plates that it is made of, one of them level; 1: it is
  /// round.
  double plate_ratio = 1;
};

/// Standard deviations of what a bench is off by; 0 leaves a parameter out. The defaults are those
/// of a bench set up by hand (docs/chain.md has the reason of each).
struct ChainSigmas {
  std::vector<Uncertainty> eye = table_5_1();
  double axial_length = 0.1e-3;      // m, retina to the eye's lens; all behind it moves along
  double lens_axial = 0.5e-3;        // m, of the condensing lens
  double lens_aside = 0.5e-3;        // m, x and y
  double lens_tilt = 0.035;          // rad, x and y, about its inner vertex
  double eye_rotation = 0.052;       // rad, x and y, about the retina's center of curvature
  double inner_lens_tilt = 0.052;    // rad, x and y, of the eye's own lens
  double inner_lens_aside = 0.2e-3;  // m, x and y
  double pupil_power = 2;            // 1/m, of 1 / the microscope's pupil distance
  double microscope_tilt = 8.7e-3;   // rad, x and y
  double object_plane = 0.5e-3;      // m, along the axis
  double pixel = 0.005;              // relative
  double center = 0.2e-3;            // m in the aerial image, x and y
  double robot_size = 0.01;          // relative, of length and width each
  double dilation_px = 0.1;          // px, of both semi-axes of every outline
  double dilation_slope = 28.6;      // px/m: a tenth of a pixel in 3.5 mm of height
  /// rad, about x, y and z: how the robot's axis is turned from where it is believed, alike in all
  /// looks, as unmeasured coils turn a commanded field. 0: what a look's own axis_sigma has is all.
  double axis_turn = 0;
  double retina_depth = 0.3e-3;        // m
  double retina_tilt = 0.1e-3;         // m at 4 mm from the axis, x and y
  double retina_curvature = 0.15e-3;   // m at 4 mm
  double retina_astigmatism = 0.1e-3;  // m at 4 mm, two directions
  /// Throws std::invalid_argument naming a negative or infinite one.
  void check() const;
  /// All zero: a bench that is as believed.
  static ChainSigmas none();
};

/// What a parameter belongs to: an uncertainty is stated with these parts apart.
enum class ChainPart { eye, calibration };

struct ChainParameter {
  std::string name;  // "lens.index", "pupil_power", "eye_rotation_x", ...
  std::string unit;  // of `sigma`: "m", "rad", "1/m", "px", "px/m" or "" for relative ones
  double sigma = 0;  // known beforehand, about the nominal value
  ChainPart part = ChainPart::calibration;
};

/// The parameters that are not 0, in an order that is the same for the same sigmas. A vector of
/// them, theta, counts each in its own sigma: before anything was measured it is N(0, 1).
std::vector<ChainParameter> chain_parameters(const NominalChain& nominal,
                                             const ChainSigmas& sigmas);

/// Throws std::invalid_argument naming what there is not.
Eigen::Index index_of(const std::vector<ChainParameter>& parameters, const std::string& name);

}  // namespace vitreo::optics
