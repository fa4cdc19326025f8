// The long form of a test: with VITREO_LONG in its environment (`make test-long`) it raises its
// counts.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdlib>

namespace vitreo {

inline bool in_long_form() { return std::getenv("VITREO_LONG") != nullptr; }

/// How many: `few` in the suite that everybody runs, `many` in the long form.
inline int long_or_short(int many, int few) { return in_long_form() ? many : few; }

}  // namespace vitreo
