// Constants of robust statistics.
// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace vitreo::vision {

/// Tukey's biweight: scale, in standard deviations, at which it has 95 % of the efficiency of least
/// squares on normal errors (Holland & Welsch 1977).
inline constexpr double kTukey = 4.685;

/// Standard deviation of a normal distribution over its median absolute deviation.
inline constexpr double kMadToSigma = 1.4826;

}  // namespace vitreo::vision
