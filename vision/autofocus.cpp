// SPDX-License-Identifier: Apache-2.0
#include "vision/autofocus.h"

#include "vision/autofocus_search.h"
#include "vision/preconditions.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace vitreo::vision {
namespace {

// The median, for an even count the mean of the middle two.
// One lucky or flickering frame does not move it.
double median_value(std::vector<FocusSample> readings) {
  std::sort(readings.begin(), readings.end(),
            [](const FocusSample& a, const FocusSample& b) { return a.value < b.value; });
  const std::size_t n = readings.size();
  return (readings[(n - 1) / 2].value + readings[n / 2].value) / 2;
}

// With backlash the lowest positions can only be reached downwards: they serve to approach from,
// not to measure at.
// Throws std::invalid_argument naming the setting. The search sees the usable range alone, so no
// strategy needs to know of backlash.
AutofocusSettings with_usable_range(AutofocusSettings settings) {
  settings.check();
  settings.low += settings.backlash;
  return settings;
}

}  // namespace

// The search yields targets; on top of it this state takes `repeats` readings at each, and goes a
// way round below a target that is approached against the backlash.
struct Autofocus::State {
  explicit State(const AutofocusSettings& chosen)
      : lowest(chosen.low),
        settings(with_usable_range(chosen)),
        search(make_focus_search(settings)) {
    target = search->next({}).value();
    under_way = settings.backlash > 0;  // the stage's last direction is not known: from below
  }

  // The next target; with backlash, a move downwards goes below it first.
  // With backlash every reading is taken after an upward move, so that the screw's play is always
  // on the same side.
  AutofocusStep go_to(double position) {
    under_way = settings.backlash > 0 && position < target;
    target = std::clamp(position, settings.low, settings.high);
    return under_way ? below() : target;
  }
  // Where an upward approach starts; not below the travel limit.
  double below() const { return std::max(target - settings.backlash, lowest); }
  // The fitted peak; without one the stage still parks at the best sample, if any was not blank.
  // Clamped to the travel: samples have the positions that the stage reported, which may lie a
  // little beyond.
  AutofocusResult finish() {
    done = true;
    AutofocusResult result{find_focus_peak(samples, settings.peak), std::nullopt, readings_used};
    const auto best = std::max_element(
        samples.begin(), samples.end(),
        [](const FocusSample& a, const FocusSample& b) { return a.value < b.value; });
    if (result.fit.peak)
      result.park = std::clamp(result.fit.peak->position, settings.low, settings.high);
    else if (best->value > 0)
      result.park = std::clamp(best->position, settings.low, settings.high);
    return result;
  }

  double lowest;
  AutofocusSettings settings;
  std::unique_ptr<FocusSearch> search;
  double target = 0;
  bool under_way = false;  // on the way below the target, not to measure
  bool done = false;
  int readings_used = 0;
  std::vector<FocusSample> readings;  // at this position
  std::vector<FocusSample> samples;   // one for each position before
};

Autofocus::Autofocus(const AutofocusSettings& settings)
    : state_(std::make_unique<State>(settings)) {}
Autofocus::~Autofocus() = default;
Autofocus::Autofocus(Autofocus&&) noexcept = default;
Autofocus& Autofocus::operator=(Autofocus&&) noexcept = default;

// With backlash the first position is not measured at: it is where the first approach starts.
// The caller moves there before its first reading.
double Autofocus::start() const {
  return state_->settings.backlash > 0 ? state_->lowest : state_->settings.low;
}

const std::vector<FocusSample>& Autofocus::samples() const { return state_->samples; }

// One reading. A stage that was under way has only arrived below the target: its reading is not
// used.
// `position` is where the stage says it is, m or whatever the settings' unit; it need not be the
// target. Throws std::logic_error after the end, so that a loop that does not stop is found.
AutofocusStep Autofocus::next(double position, double value) {
  State& s = *state_;
  if (s.done) throw std::logic_error("this autofocus search has ended");
  require(std::isfinite(position), "position: is not finite");
  require(std::isfinite(value), "value: is not finite");
  if (std::exchange(s.under_way, false)) return s.target;
  s.readings.push_back({position, value});
  ++s.readings_used;
  if (static_cast<int>(s.readings.size()) < s.settings.repeats) return s.target;
  // One sample a position: mean of the stage's real positions, median of the values.
  // The real positions, since a stage that misses its target by a step would else shift the peak.
  double sum = 0;
  for (const FocusSample& reading : s.readings) sum += reading.position;
  s.samples.push_back({sum / s.settings.repeats, median_value(s.readings)});
  s.readings.clear();
  const std::optional<double> further = s.search->next(s.samples);
  if (further) return s.go_to(*further);
  return s.finish();
}

}  // namespace vitreo::vision
