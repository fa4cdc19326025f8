// SPDX-License-Identifier: Apache-2.0
#include "host/plot/plot_axes.h"

#include "host/text/units.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace vitreo {

// False for a NaN too. 1e150: the square of a span stays finite.
bool drawable(double value) { return std::fabs(value) < 1e150; }

// A single value gets 5 % on both sides, so that its ticks differ in the digits shown.
Range widened(const Range& data) {
  if (data.empty()) return {0, 1};
  const double magnitude = std::max(std::fabs(data.low), std::fabs(data.high));
  const double least = magnitude * 1e-9;  // below that tick labels would all look alike
  if (data.span() > least) return data;
  const double half = magnitude > 0 ? magnitude * 0.05 : 1;
  return {data.low - half, data.high + half};
}

Range padded(const Range& data, double share, bool reach_zero) {
  const Range range = widened(data);
  Range result{range.low - share * range.span(), range.high + share * range.span()};
  // Within 35 % of zero: the axis begins there and shows ratios too.
  if (reach_zero && range.low >= 0 && range.low < 0.35 * range.high) result.low = 0;
  if (reach_zero && range.high <= 0 && range.high > 0.35 * range.low) result.high = 0;
  return result;
}

// The smallest of 1, 2, 5 and 10 times a power of ten that makes at most `wanted` steps (Heckbert's
// "nice numbers", Graphics Gems 1990, rounded up).
// 1e-9: a span of 0.3 divided by 3 may come out a bit above 0.1.
double nice_step(double span, double wanted) {
  const double raw = span / std::max(wanted, 1.0);
  const double power = std::pow(10.0, std::floor(std::log10(raw)));
  for (double factor : {1.0, 2.0, 5.0}) {
    if (factor * power >= raw * (1 - 1e-9)) return factor * power;
  }
  return 10 * power;
}

// Near: within 3 % of the span.
// Only ends that are near: a full step of empty plot would look like missing data.
Range snapped(const Range& range, double step) {
  const double near = 0.03 * range.span();
  const double low = std::floor(range.low / step) * step;
  const double high = std::ceil(range.high / step) * step;
  return {range.low - low <= near ? low : range.low, high - range.high <= near ? high : range.high};
}

// Labels are plain from 0.01 to 99 999; beyond, a power of ten that is a multiple of three goes
// into the axis' title. The values are multiples of the step and not sums of it, so that 0 is 0.
// Decimals come from the step, so that neighbors never have the same label. `slack`: an end of the
// range that is a multiple of the step but for rounding has its tick.
Ticks make_ticks(const Range& range, double step) {
  Ticks ticks;
  const double magnitude = std::max(std::fabs(range.low), std::fabs(range.high));
  const double order = std::floor(std::log10(magnitude));
  if (order >= 5 || order < -2) ticks.exponent = 3 * static_cast<int>(std::floor(order / 3));
  const double scale = std::pow(10.0, ticks.exponent);
  const int decimals =
      std::clamp(-static_cast<int>(std::floor(std::log10(step / scale) + 1e-9)), 0, 12);
  const double slack = 1e-9 * step;
  for (double i = std::ceil((range.low - slack) / step); i * step <= range.high + slack; ++i) {
    const double value = i * step;
    std::string label = fmt::format("{:.{}f}", std::fabs(value / scale), decimals);
    if (i < 0) label = "\u2212" + label;
    ticks.at.push_back(value);
    ticks.labels.push_back(std::move(label));
  }
  return ticks;
}

// 10^4 and more, and 10^-3 and less, as powers.
Ticks make_decades(const Range& range, double wanted) {
  constexpr double kSlack = 1e-9;
  const std::string raised[] = {"\u2070", "\u00b9", "\u00b2", "\u00b3", "\u2074",
                                "\u2075", "\u2076", "\u2077", "\u2078", "\u2079"};
  Ticks ticks;
  const bool few = range.span() * 3 <= wanted;
  const int every = std::max(1, static_cast<int>(std::ceil(range.span() / std::max(wanted, 1.0))));
  const int from = static_cast<int>(std::floor(range.low));
  for (int decade = from; decade <= range.high + kSlack; ++decade)
    for (const int factor : {1, 2, 5}) {
      if (factor > 1 && !few) continue;
      const double at = decade + std::log10(factor);
      if (at < range.low - kSlack || at > range.high + kSlack || (decade - from) % every) continue;
      std::string label = fmt::format("{:g}", factor * std::pow(10.0, decade));
      if (decade > 3 || decade < -2) {
        label = factor > 1 ? fmt::format("{}\u00b7", factor) : "";
        label += decade < 0 ? "10\u207b" : "10";
        for (const char digit : std::to_string(std::abs(decade))) label += raised[digit - '0'];
      }
      ticks.at.push_back(at);
      ticks.labels.push_back(std::move(label));
    }
  return ticks;
}

// Superscript characters of Unicode: SVG's own way, baseline-shift, is not drawn by every renderer.
std::string axis_title(const std::string& label, const std::string& unit, int exponent) {
  std::string inside;
  if (exponent != 0) {
    constexpr const char* kRaised[] = {"\u2070", "\u00b9", "\u00b2", "\u00b3", "\u2074",
                                       "\u2075", "\u2076", "\u2077", "\u2078", "\u2079"};
    inside = exponent < 0 ? "10\u207b" : "10";
    for (char digit : std::to_string(std::abs(exponent))) inside += kRaised[digit - '0'];
  }
  if (!unit.empty()) inside += (inside.empty() ? "" : " ") + print_unit(unit);
  if (inside.empty()) return label;
  return label.empty() ? inside : label + " (" + inside + ")";
}

}  // namespace vitreo
