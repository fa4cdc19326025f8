// Support of the localizer's tests: the robot of section 5.5 in the eye of table 5.3.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/pose/pose.h"
#include "tests/optics/support.h"

namespace vitreo::optics {

inline const Eigen::Vector3d kAlongX(1, 0, 0), kAlongZ(0, 0, 1), kOblique(0.5, 0.7, 0.4);

inline PoseSettings default_settings() {
  PoseSettings settings;
  settings.projection = fit_single_viewpoint(model_eye_5_3(), Microscope{}, 7 * kMm);
  settings.image.center_px = {691.5, 517.5};
  return settings;
}

/// Tracker noise: 0.2 px in each length, and the angle that goes with it.
inline EllipseCovariance tracker_noise() {
  EllipseCovariance covariance = EllipseCovariance::Identity() * 0.04;
  covariance(4, 4) = 1e-5;
  return covariance;
}

}  // namespace vitreo::optics
