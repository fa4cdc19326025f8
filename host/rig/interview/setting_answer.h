// Answers that a person types for a setting of a rig file: "3 A", "-12, -12, -5 mm", "yes".
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/config/config.h"

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace vitreo {

/// A value and how a rig file writes it.
struct WrittenValue {
  ConfigValue value;               // SI
  std::string lua;                 // "3 * A"
  std::vector<std::string> units;  // those of Lua's table `units` in it: "A"
};

/// Throws ConfigError, one sentence for the person who typed it, where the text is no value of the
/// setting's kind: a quantity wants its unit, a list its count. Bounds are not checked.
WrittenValue read_setting(const KnownSetting& setting, std::string_view typed);

/// The default as it would be typed: "12 A", "z", "no"; "none" for an empty list or text.
std::string typed_default(const KnownSetting& setting);
/// A number in SI units as it would be typed, with its unit: "15 Hz" of "15"; another text as it
/// is.
std::string as_typed(const KnownSetting& setting, const std::string& in_si);
/// What may be typed: "a current, 0.1 to 20 A", "yes or no", "x, y or z".
std::string wanted_answer(const KnownSetting& setting);

/// A value that is known as a rig file writes it, such as `1384` or `"MEAS?"`.
WrittenValue written_text(const std::string& text);
WrittenValue written_number(double plain);

}  // namespace vitreo
