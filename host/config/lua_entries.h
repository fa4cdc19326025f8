// Keys of a Lua text: where each gets its value, without running it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace vitreo {

/// One key that gets a value. Paths begin with a root: kReturnedRoot, or "@" and a variable's name.
struct LuaEntry {
  std::string path;      ///< "@return.top_camera.focus"
  int line;              ///< on which the key stands, from 1; not where its value ends
  std::string alias{};   ///< of a value that is a variable, or a call, and nothing else: its path
  bool literal = false;  ///< its value is a table constructor and nothing else
};

/// The root of what the text returns.
inline const std::string kReturnedRoot = "@return";
/// The part of a path that stands for a computed key: rig[name], cameras[#cameras + 1].
inline const std::string kComputedKey = "[]";
/// Behind the path of a function: what it returns.
inline const std::string kReturns = "()";

/// In the order of the text. Never throws: what is no Lua gives some entries.
std::vector<LuaEntry> lua_entries(std::string_view text);

}  // namespace vitreo
