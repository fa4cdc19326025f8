// SPDX-License-Identifier: Apache-2.0
#include "devices/roles/stage_axis.h"

#include "devices/time/error.h"

#include <array>
#include <cmath>
#include <cstdio>
#include <stdexcept>

namespace vitreo {
namespace {

/// Six significant digits, as %g prints them.
/// For messages alone: what is checked are the numbers themselves.
std::string in_short(double number) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%g", number);
  return text.data();
}

/// Lengths in mm and angles in degrees, as people read them.
struct Shown {
  double per_unit;
  std::string symbol;
};
Shown shown_as(const std::string& unit) {
  if (unit == "m") return {1e3, "mm"};
  return unit == "rad" ? Shown{180 / M_PI, "deg"} : Shown{1, unit};
}

}  // namespace

std::string position_text(double position, const std::string& unit) {
  const Shown shown = shown_as(unit);
  return in_short(shown.per_unit * position) + " " + shown.symbol;
}

void check_motion(const std::vector<StageAxis>& axes, std::span<const double> target, double speed,
                  const std::string& device, const char* unit) {
  // Mistakes of the caller first, limits of the axes after them: a caller's mistake is never taken
  // for a refusal of the instrument.
  if (target.size() != axes.size())
    throw std::invalid_argument("target: " + device + " has " + std::to_string(axes.size()) +
                                " axes, not " + std::to_string(target.size()));
  for (std::size_t i = 0; i < axes.size(); ++i)
    if (!std::isfinite(target[i]))
      throw std::invalid_argument("target: axis " + axes[i].name + " is not a finite number");
  if (!std::isfinite(speed) || speed <= 0) throw std::invalid_argument("speed: must be positive");
  const Shown shown = shown_as(unit);
  const auto text = [&](double value) { return in_short(shown.per_unit * value); };
  const std::string& symbol = shown.symbol;
  for (std::size_t i = 0; i < axes.size(); ++i) {
    const StageAxis& axis = axes[i];
    // No tolerance: a target on the limit is allowed, one beyond it by the last bit is not.
    if (target[i] < axis.travel_min || target[i] > axis.travel_max)
      throw DeviceError(DeviceErrorKind::out_of_range, device,
                        text(target[i]) + " " + symbol + " on axis " + axis.name +
                            " is outside its travel of " + text(axis.travel_min) + " to " +
                            text(axis.travel_max) + " " + symbol);
    if (speed > axis.max_speed)
      throw DeviceError(DeviceErrorKind::out_of_range, device,
                        text(speed) + " " + symbol + "/s is faster than the " +
                            text(axis.max_speed) + " " + symbol + "/s of axis " + axis.name);
  }
}

}  // namespace vitreo
