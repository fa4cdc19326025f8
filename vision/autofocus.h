// Autofocus search: state machine that takes a stage position with its focus measure and returns
// the next position.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/autofocus_settings.h"
#include "vision/focus_peak.h"

#include <memory>
#include <optional>
#include <variant>
#include <vector>

namespace vitreo::vision {

struct AutofocusResult {
  FocusPeakFit fit;  ///< found: fit.peak has best position and sigma; else why not
  /// Final position: the peak, else the best that was measured; nothing when all was blank.
  std::optional<double> park;
  int readings = 0;  ///< that were used
};
/// A position to go to and measure at, or the end.
using AutofocusStep = std::variant<double, AutofocusResult>;

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
