// Calibration of the dipole field model from probe readings.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/probe_readings.h"

#include <Eigen/Core>

#include <cstddef>
#include <vector>

namespace vitreo::control {

struct DipoleFit {
  CoilField field;
  Eigen::Vector3d background{0, 0, 0};  // T, uniform
  double residual_rms = 0;              // T, of one component
  double residual_largest = 0;          // T, the length of the worst reading's miss
  std::size_t worst_reading = 0;
  double residual_relative = 0;  // of the readings' own rms
  bool converged = false;
};

/// Least squares over positions and moments of all dipoles and a uniform background (Ceres), from
/// the model `start` (CoilField::octomag() for an OctoMag). Throws as check_readings; at least as
/// many numbers as unknowns are needed.
DipoleFit fit_dipoles(const CoilField& start, const std::vector<ProbeReading>& readings);

}  // namespace vitreo::control
