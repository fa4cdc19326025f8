// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/context.h"

#include <stdexcept>

namespace vitreo::lua {

Context& context_of(lua_State* L) { return **static_cast<Context**>(lua_getextraspace(L)); }

Session& session_of(lua_State* L) {
  if (Session* const session = context_of(L).session) return *session;
  throw std::runtime_error("there is no rig while a file is only being read");
}

std::string where(lua_State* L) {
  lua_Debug place;
  for (int level = 0; lua_getstack(L, level, &place); ++level) {
    lua_getinfo(L, "Sl", &place);
    if (place.currentline > 0)
      return std::string(place.short_src) + ":" + std::to_string(place.currentline) + ": ";
  }
  return "";
}

}  // namespace vitreo::lua
