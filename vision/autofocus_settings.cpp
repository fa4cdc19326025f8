// SPDX-License-Identifier: Apache-2.0
#include "vision/autofocus_settings.h"

#include "vision/preconditions.h"

#include <array>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

namespace vitreo::vision {
namespace {

// One list for both directions, so that a strategy cannot be named and not read.
constexpr std::array<std::pair<AutofocusStrategy, std::string_view>, 4> kStrategies{{
    {AutofocusStrategy::sweep, "sweep"},
    {AutofocusStrategy::coarse_to_fine, "coarse_to_fine"},
    {AutofocusStrategy::golden_section, "golden_section"},
    {AutofocusStrategy::fibonacci, "fibonacci"},
}};

}  // namespace

std::string_view name_of(AutofocusStrategy strategy) {
  for (const auto& [one, name] : kStrategies) {
    if (one == strategy) return name;
  }
  throw std::invalid_argument("strategy: there is no such autofocus strategy");
}

// Throws std::invalid_argument with the names that there are.
AutofocusStrategy autofocus_strategy(std::string_view name) {
  std::string names;
  for (const auto& [strategy, own] : kStrategies) {
    if (own == name) return strategy;
    names += (names.empty() ? "" : ", ") + std::string(own);
  }
  throw std::invalid_argument("strategy: there is no autofocus strategy \"" + std::string(name) +
                              "\"; there are " + names);
}

// The bounds keep a mistyped unit from becoming a search of hours: (high - low) / step is checked,
// not only each value.
void AutofocusSettings::check() const {
  constexpr double kMostSteps = 100000;  // a night at a reading every 0.3 s
  require(std::isfinite(low) && std::isfinite(high) && low < high,
          "low, high: must be finite, low below high");
  require(step > 0 && std::isfinite(step), "step: must be positive");
  require((high - low) / step <= kMostSteps, "step: more than 100000 steps from low to high");
  require(coarse >= 5 && coarse <= 10000, "coarse: must be 5 to 10000 positions");
  require(repeats >= 1 && repeats <= 1000, "repeats: must be 1 to 1000");
  require(backlash >= 0 && backlash <= (high - low) / 2, "backlash: must be 0 to half the travel");
  require(hysteresis >= 0 && hysteresis < 1, "hysteresis: must be 0 to 1");
  peak.check();
}

}  // namespace vitreo::vision
