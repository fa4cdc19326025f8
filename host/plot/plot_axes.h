// Axis arithmetic: ranges, and ticks at 1, 2 or 5 times a power of ten.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <limits>
#include <string>
#include <vector>

namespace vitreo {

struct Range {
  double low = std::numeric_limits<double>::infinity(),
         high = -std::numeric_limits<double>::infinity();
  void include(double value) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  bool empty() const { return !(low <= high); }
  double span() const { return high - low; }
};

/// Whether a value can be drawn: not a NaN, and not so large that arithmetic on it overflows.
bool drawable(double value);

/// A range that has an extent: one around a single value, the unit range for none.
Range widened(const Range& data);
/// With air of `share` of the span on both sides; a range that nearly reaches zero from one side
/// starts there.
Range padded(const Range& data, double share, bool reach_zero);

/// 1, 2 or 5 times a power of ten, such that about `wanted` steps make `span`.
double nice_step(double span, double wanted);

/// Each end moved out to the next multiple of `step` where that is near: a minute's data end at 60,
/// not at 59.93.
Range snapped(const Range& range, double step);

struct Ticks {
  std::vector<double> at;
  std::vector<std::string> labels;  // with a true minus sign; divided by 10^exponent
  int exponent = 0;
};
Ticks make_ticks(const Range& range, double step);
/// Of a range of base-10 logarithms: each decade, or 1, 2 and 5 of each where there are few; at
/// most `wanted` of them or so.
Ticks make_decades(const Range& range, double wanted);

/// "error (µm)", "error (10⁻⁶ T)".
std::string axis_title(const std::string& label, const std::string& unit, int exponent);

}  // namespace vitreo
