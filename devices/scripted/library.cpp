// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/library.h"

#include "devices/scripted/budget.h"
#include "devices/scripted/pattern_library.h"

#include <algorithm>
#include <cmath>
#include <string>

namespace vitreo::scripted {
namespace {

/// Bytes, and entries of a table, that are the work of one instruction.
constexpr std::int64_t kBytes = 64;
constexpr std::int64_t kEntries = 4;
constexpr std::int64_t kCopies = 128;  // of a text

/// Lua's own function, which a bounded one stands in front of; called in the same frame, so that
/// its errors name it.
int original(lua_State* L) { return lua_tocfunction(L, lua_upvalueindex(1))(L); }

std::int64_t length_of_texts(lua_State* L) {
  std::int64_t length = 0;
  for (int i = lua_gettop(L); i > 0; --i)
    if (lua_type(L, i) == LUA_TSTRING) length += static_cast<std::int64_t>(lua_rawlen(L, i));
  return length;
}

/// In proportion to its texts.
int of_texts(lua_State* L) {
  // Charged before the work: a call that is too much does not begin.
  budget::charge(L, length_of_texts(L) / kBytes);
  return original(L);
}

/// string.rep(text, count, between): an empty text as often as one likes makes nothing, and takes
/// for ever.
int repeat(lua_State* L) {
  std::size_t size = 0, between = 0;
  luaL_checklstring(L, 1, &size);
  const lua_Integer count = luaL_checkinteger(L, 2);
  luaL_optlstring(L, 3, "", &between);
  constexpr double kMost = 16 << 20;
  if (static_cast<double>(count) * static_cast<double>(size + between + 1) > kMost)
    return luaL_error(L, "string.rep: the text would be too long");
  if (count > 0) budget::charge(L, count / kCopies);
  return original(L);
}

/// Entries of the table at 1, which says its true length.
std::int64_t entries(lua_State* L) {
  luaL_checktype(L, 1, LUA_TTABLE);
  if (luaL_getmetafield(L, 1, "__len") != LUA_TNIL)
    luaL_error(L, "a table with __len is not taken here");
  return static_cast<std::int64_t>(lua_rawlen(L, 1));
}

/// In proportion to its table: table.insert, remove.
int of_table(lua_State* L) {
  budget::charge(L, entries(L) / kEntries);
  return original(L);
}

int sort(lua_State* L) {
  const auto count = static_cast<double>(entries(L));
  budget::charge(L, static_cast<std::int64_t>(count * std::log2(count + 2)));
  return original(L);
}

/// Entries from argument `from` to `to`, or to the table's end.
void charge_range(lua_State* L, int from, int to) {
  const auto end =
      static_cast<double>(lua_isnoneornil(L, to) ? entries(L) : luaL_checkinteger(L, to));
  const double count = end - static_cast<double>(luaL_optinteger(L, from, 1)) + 1;
  constexpr double kMost = 1e6;
  if (count > kMost) luaL_error(L, "a table of %f entries is too long", count);
  if (count > 0) budget::charge(L, static_cast<std::int64_t>(count) / kEntries);
}

/// table.concat(list, between, from, to)
int concatenate(lua_State* L) {
  std::size_t between = 0;
  luaL_optlstring(L, 2, "", &between);
  charge_range(L, 3, 4);
  return original(L);
}
/// table.unpack(list, from, to)
int unpack(lua_State* L) {
  charge_range(L, 2, 3);
  return original(L);
}
/// table.move(list, from, to, at, other)
int move(lua_State* L) {
  charge_range(L, 2, 3);
  return original(L);
}

/// The budget of the file's call.
class BudgetAccount : public PatternAccount {
 public:
  void search(lua_State* L, const std::function<void(PatternSteps&)>& search) const override {
    const std::int64_t all = budget::left(L) * kSteps;
    PatternSteps steps(all);
    search(steps);
    budget::spend(L, (all - steps.left) / kSteps);
  }
  void charge(lua_State* L, std::int64_t work) const override { budget::charge(L, work); }
  std::size_t longest() const override { return 4u << 20; }

 private:
  static constexpr std::int64_t kSteps = 2;  // of a match, that are the work of one instruction
};

/// A finalizer would run whenever memory is collected, the host's own included, and no hook looks
/// into it.
int set_metatable(lua_State* L) {
  if (lua_type(L, 2) == LUA_TTABLE) {
    lua_pushliteral(L, "__gc");
    const bool finalizer = lua_rawget(L, 2) != LUA_TNIL;
    lua_pop(L, 1);
    if (finalizer)
      return luaL_error(L, "setmetatable: __gc cannot be used in an instrument's file");
  }
  return original(L);
}

struct Bound {
  const char* name;
  lua_CFunction instead;
};

/// [table] -> [table]
void put_in_front(lua_State* L, std::initializer_list<Bound> rows) {
  for (const Bound& row : rows) {
    lua_getfield(L, -1, row.name);
    lua_pushcclosure(L, row.instead, 1);
    lua_setfield(L, -2, row.name);
  }
}
void remove(lua_State* L, std::initializer_list<const char*> names) {
  for (const char* name : names) {
    lua_pushnil(L);
    lua_setfield(L, -2, name);
  }
}

}  // namespace

void open_library(lua_State* L) {
  const luaL_Reg libraries[] = {{LUA_GNAME, luaopen_base},
                                {LUA_TABLIBNAME, luaopen_table},
                                {LUA_STRLIBNAME, luaopen_string},
                                {LUA_MATHLIBNAME, luaopen_math},
                                {nullptr, nullptr}};
  for (const luaL_Reg* library = libraries; library->func != nullptr; ++library) {
    luaL_requiref(L, library->name, library->func, 1);
    lua_pop(L, 1);
  }
  lua_pushglobaltable(L);
  remove(L, {"dofile", "loadfile", "load", "collectgarbage", "warn", "print", "getmetatable",
             "rawset", "xpcall"});
  put_in_front(L, {{"setmetatable", set_metatable}, {"tonumber", of_texts}});
  lua_getfield(L, -1, LUA_MATHLIBNAME);  // a run is the same each time
  remove(L, {"random", "randomseed"});
  lua_pop(L, 1);
  lua_getfield(L, -1, LUA_TABLIBNAME);
  put_in_front(L, {{"concat", concatenate},
                   {"insert", of_table},
                   {"move", move},
                   {"remove", of_table},
                   {"sort", sort},
                   {"unpack", unpack}});
  lua_pop(L, 1);
  lua_getfield(L, -1, LUA_STRLIBNAME);
  remove(L, {"dump"});
  put_in_front(L, {{"byte", of_texts},
                   {"format", of_texts},
                   {"lower", of_texts},
                   {"pack", of_texts},
                   {"rep", repeat},
                   {"reverse", of_texts},
                   {"sub", of_texts},
                   {"unpack", of_texts},
                   {"upper", of_texts}});
  static const BudgetAccount kAccount;
  open_patterns(L, kAccount);
  lua_pop(L, 2);
}

}  // namespace vitreo::scripted
