// Functions of Lua's library whose C code could run for long between two instructions: here a stop
// is felt inside of them, or what they make has a bound.
// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/pattern_library.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/state.h"
#include "host/lua/interpreter/stop.h"

#include <algorithm>
#include <cstring>

namespace vitreo::lua {
namespace {

constexpr lua_Integer kLongestText = 16 << 20;  // bytes: a call over it takes some 10 ms
constexpr lua_Integer kShortList = 4096;        // entries that need no look in between

/// Lua's own function, upvalue 1, in the same frame, so that its errors name it.
int original(lua_State* L) { return lua_tocfunction(L, lua_upvalueindex(1))(L); }

/// In proportion to its text, the first argument.
int of_text(lua_State* L) {
  if (lua_type(L, 1) == LUA_TSTRING && static_cast<lua_Integer>(lua_rawlen(L, 1)) > kLongestText)
    return luaL_error(L, "a text of more than 16 MB is not taken here");
  return original(L);
}

/// string.rep(text, count, between). By doubling, for Lua's own copies one by one: of an empty text
/// for ever.
int repeat(lua_State* L) {
  std::size_t size = 0, gap = 0;
  const char* const text = luaL_checklstring(L, 1, &size);
  const lua_Integer count = std::max<lua_Integer>(luaL_checkinteger(L, 2), 0);
  const char* const between = luaL_optlstring(L, 3, "", &gap);
  // The text and what stands between two of them, but for the last.
  const std::size_t one = size + gap;
  if (count == 0 || one == 0) return lua_pushliteral(L, ""), 1;
  if (count > kLongestText / static_cast<lua_Integer>(one))
    return luaL_error(L, "string.rep: the text would be longer than 16 MB");
  const std::size_t whole = one * static_cast<std::size_t>(count);
  // In memory of Lua's own, whose cap holds here as everywhere.
  luaL_Buffer buffer;
  char* const made = luaL_buffinitsize(L, &buffer, whole);
  std::memcpy(made, text, size);
  std::memcpy(made + size, between, gap);
  // Each time as much as is there already, so that no copy overlaps.
  for (std::size_t done = one; done < whole; done *= 2)
    std::memcpy(made + done, made, std::min(done, whole - done));
  luaL_pushresultsize(&buffer, whole - gap);
  return 1;
}

/// For table.sort without a comparison of its own: a call, before which the hook of a stop acts.
int less_than(lua_State* L) {
  lua_pushboolean(L, lua_compare(L, 1, 2, LUA_OPLT));
  return 1;
}

/// table.sort(list, less)
int sort(lua_State* L) {
  luaL_checktype(L, 1, LUA_TTABLE);
  // With a function of the script the hook acts at its calls already. Short lists keep the quicker
  // way.
  if (lua_isnoneornil(L, 2) && luaL_len(L, 1) > kShortList) {
    lua_settop(L, 1);
    lua_pushcfunction(L, less_than);
  }
  return original(L);
}

/// Lua's own message for what is no table and has no __index, __newindex.
void check_list(lua_State* L, int index) {
  if (lua_istable(L, index) || luaL_getmetafield(L, index, "__index") != LUA_TNIL ||
      luaL_getmetafield(L, index, "__newindex") != LUA_TNIL)
    return;
  luaL_checktype(L, index, LUA_TTABLE);
}

/// The list's length as Lua's table functions take it.
lua_Integer length_of(lua_State* L) {
  const int arguments = lua_gettop(L);
  check_list(L, 1);
  lua_settop(L, arguments);  // without the metafields that were asked for
  return luaL_len(L, 1);
}

/// list[to] = list[from], of the list at 1; a look at the first of many.
void copy_entry(lua_State* L, lua_Integer from, lua_Integer to) {
  if (to % kShortList == 0) feel_stop(L);
  lua_geti(L, 1, from);
  lua_seti(L, 1, to);
}

/// table.insert(list, at, value), table.insert(list, value)
int insert(lua_State* L) {
  const auto end = static_cast<lua_Integer>(static_cast<lua_Unsigned>(length_of(L)) + 1);
  lua_Integer at = end;
  if (lua_gettop(L) == 3) {
    at = luaL_checkinteger(L, 2);
    luaL_argcheck(L, static_cast<lua_Unsigned>(at) - 1 < static_cast<lua_Unsigned>(end), 2,
                  "position out of bounds");
    for (lua_Integer i = end; i > at; --i) copy_entry(L, i - 1, i);
  } else if (lua_gettop(L) != 2) {
    return luaL_error(L, "wrong number of arguments to 'insert'");
  }
  lua_seti(L, 1, at);
  return 0;
}

/// table.remove(list, at)
int take_out(lua_State* L) {
  const lua_Integer size = length_of(L);
  lua_Integer at = luaL_optinteger(L, 2, size);
  if (at != size)
    luaL_argcheck(L, static_cast<lua_Unsigned>(at) - 1 <= static_cast<lua_Unsigned>(size), 2,
                  "position out of bounds");
  lua_geti(L, 1, at);
  for (; at < size; ++at) copy_entry(L, at + 1, at);
  lua_pushnil(L);
  lua_seti(L, 1, at);
  return 1;
}

/// table.move(list, from, to, at, other), as Lua's own, with a look now and then.
int move(lua_State* L) {
  const lua_Integer from = luaL_checkinteger(L, 2), to = luaL_checkinteger(L, 3),
                    at = luaL_checkinteger(L, 4);
  const int other = lua_isnoneornil(L, 5) ? 1 : 5;
  check_list(L, 1);
  check_list(L, other);
  if (to >= from) {
    luaL_argcheck(L, from > 0 || to < LUA_MAXINTEGER + from, 3, "too many elements to move");
    const lua_Integer count = to - from + 1;
    luaL_argcheck(L, at <= LUA_MAXINTEGER - count + 1, 4, "destination wrap around");
    // Backwards where the ranges overlap, so that nothing is overwritten before it was moved.
    const bool forwards =
        at > to || at <= from || (other != 1 && !lua_compare(L, 1, other, LUA_OPEQ));
    for (lua_Integer i = 0; i < count; ++i) {
      if (i % kShortList == 0) feel_stop(L);
      const lua_Integer k = forwards ? i : count - 1 - i;
      lua_geti(L, 1, from + k);
      lua_seti(L, other, at + k);
    }
  }
  lua_pushvalue(L, other);
  return 1;
}

/// Steps without an end, but for a stop; and for a file that is only read.
class StoppableSteps : public scripted::PatternSteps {
 public:
  /// A stop is felt outside of the matcher: what is thrown through it is ours.
  struct Felt {};
  explicit StoppableSteps(const Context& context) : PatternSteps(kAtOnce), context_(context) {}
  void use_up() override {
    // A file that is only read has no stop to wait for: it has its fill of steps, once a call.
    if (context_.session == nullptr) throw scripted::PatternWork();
    if (context_.interrupted) throw Felt();
    left = kAtOnce;
  }

 private:
  static constexpr std::int64_t kAtOnce = 100'000;  // about half a millisecond
  const Context& context_;
};

class StoppableAccount : public scripted::PatternAccount {
 public:
  void search(lua_State* L,
              const std::function<void(scripted::PatternSteps&)>& search) const override {
    // Felt ends in its handler before the stop is raised, which may be a jump of Lua's.
    StoppableSteps steps(context_of(L));
    try {
      return search(steps);
    } catch (const StoppableSteps::Felt&) {
    }
    feel_stop(L);
  }
  void charge(lua_State* L, std::int64_t) const override { feel_stop(L); }
  std::size_t longest() const override { return kLongestText; }
};

struct Bounded {
  const char* name;
  lua_CFunction instead;
};

/// Lua's own function becomes upvalue 1 of the one in its place (see original()).
void put_in_front(lua_State* L, const char* library, std::initializer_list<Bounded> rows) {
  lua_getglobal(L, library);
  for (const Bounded& row : rows) {
    lua_getfield(L, -1, row.name);
    lua_pushcclosure(L, row.instead, 1);
    lua_setfield(L, -2, row.name);
  }
  lua_pop(L, 1);
}

}  // namespace

void open_long_calls(lua_State* L) {
  // The methods of texts find these, too: their metatable's __index is the table itself.
  put_in_front(L, LUA_STRLIBNAME,
               {{"byte", of_text},
                {"lower", of_text},
                {"rep", repeat},
                {"reverse", of_text},
                {"unpack", of_text},
                {"upper", of_text}});
  put_in_front(L, LUA_TABLIBNAME,
               {{"insert", insert}, {"move", move}, {"remove", take_out}, {"sort", sort}});
  put_in_front(L, LUA_UTF8LIBNAME, {{"codepoint", of_text}, {"len", of_text}, {"offset", of_text}});
  static const StoppableAccount kAccount;
  lua_getglobal(L, LUA_STRLIBNAME);
  scripted::open_patterns(L, kAccount);
  lua_pop(L, 1);
}

}  // namespace vitreo::lua
