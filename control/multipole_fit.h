// Calibration of the multipole field model from probe readings.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/multipole_field.h"
#include "control/probe_readings.h"

#include <Eigen/Core>

#include <vector>

namespace vitreo::control {

struct MultipoleFit {
  // valid in the box that the readings span; its own background sources as `start` has them
  MultipoleField field;
  Eigen::Vector3d background{0, 0, 0};  // T, uniform, besides
  ResidualReport residual;
  bool converged = false;
};

/// Least squares (Ceres) over every coil source's position, axis and coefficients and a uniform
/// background, from `start`, which says how many sources a coil has and to which order: a
/// calibration that was measured before, or `multipoles_like`. Such fits are sensitive to where
/// they start; the residual says whether to believe this one. Throws std::invalid_argument as
/// check_readings, for readings that span no box, and for a source of `start` without coefficients.
MultipoleFit fit_multipoles(const MultipoleField& start, const std::vector<ProbeReading>& readings);

/// The dipoles as sources of order `order`, the higher coefficients zero: the start of a fit.
MultipoleField multipoles_like(const CoilField& dipoles, int order, const Region& region);

}  // namespace vitreo::control
