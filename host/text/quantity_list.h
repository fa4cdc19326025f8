// Quantities written in one word, as lists (0.1,0.5,1mm/s) and ranges (0.1..2mm/s): a number
// without a unit has that of the next one behind it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace vitreo {

/// The parts between the separators; one, maybe empty, where there is none.
std::vector<std::string> split_text(std::string_view text, std::string_view separator);

/// Gives each item that is a bare number the unit of the nearest later item that has one.
void share_units(std::vector<std::string>& items);

/// "0.1,0.5,1mm/s" as {"0.1mm/s", "0.5mm/s", "1mm/s"}.
std::vector<std::string> split_list(std::string_view text);

/// "0.1..2mm/s" as {"0.1mm/s", "2mm/s"}; nothing for what has not exactly one "..".
std::optional<std::pair<std::string, std::string>> split_range(std::string_view text);

}  // namespace vitreo
