// Autofocus settings: strategy, travel and accuracy of a search.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/focus_peak.h"

#include <string_view>

namespace vitreo::vision {

enum class AutofocusStrategy {
  sweep,           ///< every step from low to high: slow, and finds the peak whatever the curve
  coarse_to_fine,  ///< sweeps of ever smaller step about the best of the one before: the default
  golden_section,  ///< a coarse sweep, then the bracket shrinks by the golden ratio
  fibonacci,       ///< the same on whole steps
};
std::string_view name_of(AutofocusStrategy strategy);
/// By name, as written above. Throws std::invalid_argument that lists the names.
AutofocusStrategy autofocus_strategy(std::string_view name);

/// Positions in any one unit.
struct AutofocusSettings {
  AutofocusStrategy strategy = AutofocusStrategy::coarse_to_fine;
  /// Travel limits: no position outside is ever requested.
  double low = 0;
  double high = 1;
  double step = 0.01;  ///< the finest
  int coarse = 11;     ///< positions of the first sweep; 5 at least
  /// Readings per position, of which the median counts: against flicker and passing floaters.
  int repeats = 1;
  /// A move downwards first overshoots by this much, so that every position is approached upwards.
  double backlash = 0;
  /// Values that differ by less, relatively, do not decide which side is better.
  double hysteresis = 0.02;
  FocusPeakSettings peak;
  void check() const;  ///< throws std::invalid_argument naming the setting
};

}  // namespace vitreo::vision
