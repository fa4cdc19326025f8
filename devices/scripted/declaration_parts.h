// Parts of a declaration that have a source of their own: the link, and the quantities and
// commands. For declaration.cpp alone.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/scripted/declaration.h"
#include "devices/scripted/table_reader.h"

#include <algorithm>
#include <cstddef>
#include <string>
#include <vector>

namespace vitreo::scripted {

/// What a bound that is not given may be at most, in any unit.
inline constexpr double kHuge = 1e300;

/// One of an enumeration whose names are in its order.
template <class Enum>
Enum read_enum(TableReader& reader, const std::string& key, const std::vector<std::string>& names,
               Enum usual) {
  const std::string name = reader.text(key, names[static_cast<std::size_t>(usual)]);
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end()) {
    std::string all;
    for (const std::string& one : names) all += (all.empty() ? "" : ", ") + one;
    reader.fail(key, "must be one of " + all);
  }
  return static_cast<Enum>(found - names.begin());
}

/// The unit of `key`; none where it is not there.
DeclaredUnit read_unit(TableReader& reader, const UnitLookup& units,
                       const std::string& key = "unit");

/// Names become Lua methods and columns of the record.
void check_name(TableReader& reader, const std::string& name);

/// link = { baud_rate = 9600, terminator = "\n" }
LinkDeclaration read_link(TableReader& all);

/// In the unit of the file here; `info` is in SI, which is all that the host sees.
PropertyDeclaration read_property(TableReader& all, const std::string& name,
                                  const UnitLookup& units, const Framing& framing);

CommandDeclaration read_command(TableReader& all, const std::string& name, const UnitLookup& units);

}  // namespace vitreo::scripted
