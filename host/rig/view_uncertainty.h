// Uncertainty of the view: what a rig file says that it does not know of bench, camera, robot and
// walls.
// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace vitreo {

/// What the robot's surface keeps away from retina and lens, and what is doubtful of where it is
/// found beside the noise of its measurement (control/clearance.h).
struct KeepOutSettings {
  double margin = 0.2e-3;  // m, of the clearance's lower bound
  /// Relative, one sigma: of the robot's size in the image (its size, its outline, the pixel),
  /// which a depth is found by.
  double scale_uncertainty = 0.015;
  bool eye_uncertain = false;  // the eye is known no better than thesis table 5.1 says
};

/// How well a laboratory knows where eye, condensing lens and microscope stand, which no
/// calibration has measured: standard deviations, m and rad. The defaults are the tolerances of a
/// bench set up by hand (docs/chain.md has the reason of each). Those of the retina count where its
/// depth does: for walls and for a look at a robot that lies on it.
struct BenchUncertainty {
  double pupil_power = 2.3;  // 1/m, 1 / pupil distance: root mean square of 0 to 4, believed 0
  double microscope_tilt = 8.7e-3;   // about x and y
  double object_plane = 0.5e-3;      // along the axis
  double pixel = 0.005;              // relative, of the aerial image, besides the camera's own
  double center = 0.2e-3;            // of the aerial image, x and y
  double lens_axial = 0.5e-3;        // of the condensing lens
  double lens_aside = 0.5e-3;        // x and y
  double lens_tilt = 0.035;          // x and y
  double eye_rotation = 0.052;       // x and y, about the retina's center
  double inner_lens_aside = 0.2e-3;  // of the eye's own lens, x and y
  double inner_lens_tilt = 0.052;    // x and y
  double axial_length = 0.1e-3;      // retina to the eye's lens
  double retina_depth = 0.3e-3;
  double retina_curvature = 0.15e-3;  // of sag, 4 mm from the axis
  bool by_hand = true;  // set up by hand: what was not measured of it has these defaults
  /// Everything stands as believed: of a bench that was measured, or that is none.
  static BenchUncertainty none() { return {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, false}; }
};

/// How well a laboratory knows what its localization takes for known: standard deviations, of
/// errors that stay. The defaults are those that a simulated rig's plant is drawn with
/// (docs/simulated_laboratory.md).
struct ViewUncertainty {
  double size = 0.01;    // relative, of the robot
  double pixel = 0.005;  // relative, of each camera's scale
  double tilt = 3.5e-3;  // rad, of each camera against the world
  double eye = 50e-6;    // m, of the eye's place along each axis
  BenchUncertainty bench;
};

}  // namespace vitreo
