// Picture faults applied to a frame: wrong light, wrong focus, a floater.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/sim/faults.h"

#include <opencv2/core/mat.hpp>

namespace vitreo::sim {

/// Of an 8-bit picture exposed at `exposed`, gray or color: `picture` itself where nothing is wrong
/// with it, else a new one. The noise is taken as it is, so it is blurred, amplified and dimmed
/// with the rest.
cv::Mat spoiled(const cv::Mat& picture, const PictureFaults& faults, Time exposed);

}  // namespace vitreo::sim
