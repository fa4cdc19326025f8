// SPDX-License-Identifier: Apache-2.0
#include "host/safety/coil_rest.h"

#include <fmt/format.h>

#include <cmath>
#include <cstddef>

namespace vitreo {
namespace {

/// Of the coil that carries most; nothing where none is measured.
std::optional<std::size_t> largest(const std::vector<double>& currents) {
  std::optional<std::size_t> found;
  for (std::size_t coil = 0; coil < currents.size(); ++coil)
    if (!std::isnan(currents[coil]) &&
        (!found || std::abs(currents[coil]) > std::abs(currents[*found])))
      found = coil;
  return found;
}

}  // namespace

bool at_zero(const CoilRest& rest) {
  if (!rest.failure.empty() || !rest.measured) return false;
  const auto most = largest(*rest.measured);
  return most && std::abs((*rest.measured)[*most]) <= kZeroCurrent;
}

std::string to_text(const CoilRest& rest, const std::string& moment) {
  if (!rest.failure.empty())
    return fmt::format("whether the coils are at 0 A is not known at {}: {}", moment, rest.failure);
  const auto most = rest.measured ? largest(*rest.measured) : std::nullopt;
  if (!most) return fmt::format("coils set to 0 A at {}; this rig has no read-back", moment);
  const double current = (*rest.measured)[*most];
  if (at_zero(rest))
    return fmt::format("coils {:.2f} A, read back at {}", std::abs(current), moment);
  return fmt::format("coils NOT at zero: coil {} carries {:.3g} A, read back at {}", *most + 1,
                     current, moment);
}

}  // namespace vitreo
