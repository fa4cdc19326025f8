// Where a focus measure peaks, between the steps, and how sure that is. No peak and a peak at the
// end are answers too.
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
  double sigma = 0;  ///< one standard deviation: noise of the samples, and how far the curve is
                     ///< from a parabola
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
  double depth = 0.7;  ///< the parabola is fitted down to exp(-depth) of the peak, and to three
                       ///< samples at least
  double least_noise =
      0.002;  ///< relative, of one sample: a few samples may look better than they are
  double significance = 7;  ///< the peak stands this many standard deviations of noise above the
                            ///< lowest, both smoothed
  void check() const;       ///< throws std::invalid_argument naming the setting
};

/// A parabola through the logarithm of the measure, by least squares that outliers do not pull.
/// Positions in any order, with repeats. Throws std::invalid_argument when a position or a value is
/// not finite.
FocusPeakFit find_focus_peak(std::span<const FocusSample> samples,
                             const FocusPeakSettings& settings = {});

}  // namespace vitreo::vision
