// Autofocus search: state machine that takes a stage position with its focus measure and returns
// the next position.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/focus_peak.h"

#include <memory>
#include <optional>
#include <string_view>
#include <variant>
#include <vector>

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

struct AutofocusDone {
  FocusPeakFit fit;  ///< found: fit.peak has best position and sigma; else why not
  /// Final position: the peak, else the best that was measured; nothing when all was blank.
  std::optional<double> park;
  int readings = 0;  ///< that were used
};
/// A position to go to and measure at, or the end.
using AutofocusStep = std::variant<double, AutofocusDone>;

/// One search. Pure: the caller moves the stage and measures.
class Autofocus {
 public:
  explicit Autofocus(const AutofocusSettings& settings);
  ~Autofocus();
  Autofocus(Autofocus&&) noexcept;
  Autofocus& operator=(Autofocus&&) noexcept;

  double start() const;  ///< the first position
  /// `position` is where the stage really is, `value` the measure there. Throws
  /// std::invalid_argument when either is not finite, std::logic_error after the end.
  AutofocusStep next(double position, double value);
  const std::vector<FocusSample>& samples() const;  ///< what was used so far, in order

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace vitreo::vision
