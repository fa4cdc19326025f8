// Terms of the focus measures: a pixel's contribution, and the measure from the sums over a window.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/focus_measure.h"

#include <cstdint>
#include <string_view>
#include <vector>

namespace vitreo::vision {

/// One row of pixels and the rows about it. Integers throughout, so that the difference of two
/// table entries is exact.
struct FocusRow {
  const unsigned char* const* rows;  ///< rows[-reach] to rows[reach]
  int begin;                         ///< first column
  int end;                           ///< behind the last
  /// Out, from index 0; response only where a rule has one, else untouched.
  std::int32_t* term;
  std::int32_t* response;
  std::vector<std::int32_t>* scratch;
};

struct FocusRule {
  FocusMeasure measure;
  std::string_view name;
  int reach;  ///< px of neighborhood on every side
  void (*terms)(const FocusRow&);
  double (*value)(double mean, double term, double response);  ///< of the window's means
};

const FocusRule& rule_of(FocusMeasure measure);

}  // namespace vitreo::vision
