// Derivatives of a line's refraction at one surface of the chain, in closed form.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/chain/line_step.h"

#include <Eigen/Core>

namespace vitreo::optics::detail {

/// d inner line / d (outer line, numbers of the surface), both counted in the nominal eye frame.
using StepDerivative = Eigen::Matrix<double, 4, 11>;

/// refract_inwards() with what moves its result: the outer line's four numbers, then the surface's
/// seven (SurfaceNumbers). False where it misses or all is reflected.
bool refract_inwards(const ChainStep<double>& at, LineOf<double>& line, StepDerivative& by);

}  // namespace vitreo::optics::detail
