// Rest of the coils: what is known of their currents after they were made safe.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"

#include <optional>
#include <string>
#include <vector>

namespace vitreo {

struct CoilRest {
  Time at{};  ///< when they were read back; without a read-back when they were set to zero
  std::string failure;  ///< why it is not known; empty where it is
  /// A, by coil, not a number where that one is not measured; nothing: this rig has no read-back.
  std::optional<std::vector<double>> measured;
};

/// A, of a reading that counts as zero: noise and offsets of the amplifiers are below.
constexpr double kZeroCurrent = 0.05;

/// Whether all that was measured counts as zero.
bool at_zero(const CoilRest& rest);
/// "coils 0.00 A, read back at 12:03:11.250"; `moment`: when, as people read it.
std::string to_text(const CoilRest& rest, const std::string& moment);

}  // namespace vitreo
