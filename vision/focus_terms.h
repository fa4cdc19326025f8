// What one pixel adds to a focus measure, and how the sums over a window become the measure.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/focus.h"

#include <cstdint>
#include <string_view>
#include <vector>

namespace vitreo::vision {

/// One row of pixels and the rows about it. Integers throughout, so that a strip taken off is
/// exactly what was added.
struct FocusRow {
  const unsigned char* const* rows;  ///< rows[-reach] to rows[reach]
  int begin, end;                    ///< columns
  std::int32_t *term,
      *response;  ///< out, from index 0; response only where a rule has one, else untouched
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
