// Pattern functions with bounded work: string.find, match, gmatch and gsub.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/scripted/pattern.h"

#include <lua.hpp>

#include <cstddef>
#include <cstdint>
#include <functional>

namespace vitreo::scripted {

/// Account of the work that the pattern functions of one kind of state do.
class PatternAccount {
 public:
  virtual ~PatternAccount() = default;
  /// Calls `search` with the steps that it may take, and books those that it took.
  virtual void search(lua_State* L, const std::function<void(PatternSteps&)>& search) const = 0;
  /// Books `work` that is no step; an error of Lua's where that is too much.
  virtual void charge(lua_State* L, std::int64_t work) const = 0;
  /// Bytes of the longest text that gsub may make.
  virtual std::size_t longest() const = 0;
};

/// Puts them in the place of Lua's own: [string table] -> [string table]. The account outlives the
/// state.
void open_patterns(lua_State* L, const PatternAccount& account);

}  // namespace vitreo::scripted
