// Preconditions of the folder's functions: one check that throws one kind of exception.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <stdexcept>
#include <string>

namespace vitreo::vision {

/// Throws std::invalid_argument(what) unless `holds`. `what` names the argument and says what is
/// allowed: "gate_px: must be 2 to 100".
inline void require(bool holds, const char* what) {
  if (!holds) throw std::invalid_argument(what);
}
inline void require(bool holds, const std::string& what) {
  if (!holds) throw std::invalid_argument(what);
}

}  // namespace vitreo::vision
