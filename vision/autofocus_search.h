// Autofocus strategies: choice of the next position from the samples measured so far.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/autofocus_settings.h"

#include <memory>
#include <optional>
#include <vector>

namespace vitreo::vision {

class FocusSearch {
 public:
  virtual ~FocusSearch() = default;
  /// The next position within the limits, or nothing at the end. `samples`: one for each position
  /// asked for, in order.
  virtual std::optional<double> next(const std::vector<FocusSample>& samples) = 0;
};

/// The strategy of `settings`, within settings.low and settings.high.
std::unique_ptr<FocusSearch> make_focus_search(const AutofocusSettings& settings);

}  // namespace vitreo::vision
