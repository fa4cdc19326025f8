// Lens design (thesis 3.2): shapes of chosen surfaces that flatten the aerial image of the retina.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/design/design_options.h"
#include "optics/design/design_result.h"
#include "optics/system/prescriptions.h"

namespace vitreo::optics {

/// Least squares of distances from a common focus, spot sizes and penalties on constraints, by
/// Ceres with derivatives of the traced system; four continuation paths are tried (all at once,
/// fields from the axis outwards, low orders first, both) and the best end is kept. Fields whose
/// bundles the start loses (a spherical lens loses its edge) join as soon as they come through.
/// Finds the optimum near the start, no global one. Throws std::invalid_argument for bad options,
/// naming them, and when not one bundle comes through at the start.
LensDesign design_lens(const Prescription& start, const LensDesignOptions& options);

}  // namespace vitreo::optics
