// Focus peak: position of a focus measure's maximum between the samples, with its standard
// deviation, or the finding that there is none or that it lies beyond an end.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <string_view>

namespace vitreo::vision {

struct FocusSample {
  double position = 0;  ///< any unit; the peak comes in the same
  double value = 0;     ///< of a focus measure
};

struct FocusPeak {
  double position = 0;
  double sigma = 0;  ///< one standard deviation: noise of the samples and misfit of the parabola
  double value = 0;  ///< of the fitted curve at the peak
};

enum class FocusAnswer {
  found,
  at_low_end,   ///< the measure still rises at the lowest position: go on there
  at_high_end,  ///< at the highest
  no_peak,      ///< nothing stands out of the noise, or there are fewer than three positions
};
std::string_view name_of(FocusAnswer answer);

struct FocusPeakFit {
  FocusAnswer answer = FocusAnswer::no_peak;
  std::optional<FocusPeak> peak;  ///< exactly when found
  double noise = 0;               ///< relative, of one sample, estimated from the samples
};

struct FocusPeakSettings {
  /// The parabola is fitted down to exp(-depth) of the peak, and to three samples at least.
  double depth = 0.7;
  /// Relative, of one sample: a few samples may scatter less than their noise.
  double least_noise = 0.002;
  /// Standard deviations of noise by which the peak exceeds the lowest sample, both smoothed.
  double significance = 7;
  void check() const;  ///< throws std::invalid_argument naming the setting
};

/// Gaussian interpolation as in shape from focus (Nayar & Nakagawa 1994), here by robust least
/// squares (Tukey) over all samples near the peak: a parabola through the logarithm of the measure.
/// Positions in any order, with repeats. Throws std::invalid_argument when a position or a value is
/// not finite.
FocusPeakFit find_focus_peak(std::span<const FocusSample> samples,
                             const FocusPeakSettings& settings = {});

}  // namespace vitreo::vision
