// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/pattern_library.h"

#include <algorithm>
#include <string>
#include <string_view>

namespace vitreo::scripted {
namespace {

/// The first upvalue of each of the functions.
const PatternAccount& account_of(lua_State* L) {
  return *static_cast<const PatternAccount*>(lua_touserdata(L, lua_upvalueindex(1)));
}

std::string_view text_at(lua_State* L, int index) {
  std::size_t size = 0;
  const char* const text = luaL_checklstring(L, index, &size);
  return {text, size};
}

/// Where a search begins, from 0: the argument counts from 1, and from the end where it is
/// negative.
std::size_t beginning(lua_State* L, int index, std::size_t size) {
  const lua_Integer from = luaL_optinteger(L, index, 1);
  if (from > 0) return static_cast<std::size_t>(from) - 1;
  if (from == 0 || from < -static_cast<lua_Integer>(size)) return 0;
  return size - static_cast<std::size_t>(-from);
}

/// `search(steps)` on the account.
template <class Search>
std::optional<PatternMatch> charged(lua_State* L, const Search& search) {
  std::optional<PatternMatch> found;
  std::string problem;
  account_of(L).search(L, [&](PatternSteps& steps) {
    try {
      found = search(steps);
    } catch (const PatternError& error) {
      problem = error.what();
    } catch (const PatternWork& error) {
      problem = error.what();
    }
  });
  // No exception leaves the search, so that the account books its steps whatever comes of it; the
  // error is raised behind it.
  if (!problem.empty()) luaL_error(L, "%s", problem.c_str());
  return found;
}

void push_capture(lua_State* L, std::string_view subject, const PatternCapture& capture) {
  if (capture.position) {
    lua_pushinteger(L, static_cast<lua_Integer>(capture.begin) + 1);
  } else {
    lua_pushlstring(L, subject.data() + capture.begin, capture.size);
  }
}

/// All captures, or the whole match where there are none and it is wanted.
int push_captures(lua_State* L, std::string_view subject, const PatternMatch& found, bool whole) {
  if (found.captures.empty() && whole) {
    lua_pushlstring(L, subject.data() + found.begin, found.end - found.begin);
    return 1;
  }
  luaL_checkstack(L, static_cast<int>(found.captures.size()), "too many captures");
  for (const PatternCapture& one : found.captures) push_capture(L, subject, one);
  return static_cast<int>(found.captures.size());
}

bool is_plain(std::string_view pattern) {
  return pattern.find_first_of("^$*+?.([%-") == std::string_view::npos;
}

// find(text, pattern, from, plain) gives first, last and the captures; match() the captures.
int search(lua_State* L, bool find) {
  const std::string_view text = text_at(L, 1), pattern = text_at(L, 2);
  const std::size_t from = beginning(L, 3, text.size());
  if (from > text.size()) return lua_pushnil(L), 1;
  const PatternAccount& account = account_of(L);
  account.charge(L, static_cast<std::int64_t>(text.size() / 64));
  if (find && (lua_toboolean(L, 4) != 0 || is_plain(pattern))) {
    // Plain search goes forward and back too: a step a comparison, as for a pattern.
    account.charge(L, static_cast<std::int64_t>((text.size() - from) * pattern.size() / 256));
    const std::size_t at = text.find(pattern, from);
    if (at == std::string_view::npos) return lua_pushnil(L), 1;
    lua_pushinteger(L, static_cast<lua_Integer>(at) + 1);
    lua_pushinteger(L, static_cast<lua_Integer>(at + pattern.size()));
    return 2;
  }
  const auto found =
      charged(L, [&](PatternSteps& steps) { return find_pattern(text, pattern, from, steps); });
  if (!found) return lua_pushnil(L), 1;
  if (!find) return push_captures(L, text, *found, true);
  lua_pushinteger(L, static_cast<lua_Integer>(found->begin) + 1);
  lua_pushinteger(L, static_cast<lua_Integer>(found->end));
  return 2 + push_captures(L, text, *found, false);
}

int string_find(lua_State* L) { return search(L, true); }
int string_match(lua_State* L) { return search(L, false); }

// Upvalues: account, text, pattern, where to go on, where the last match ended (an empty one there
// is none).
int next_match(lua_State* L) {
  const std::string_view text = text_at(L, lua_upvalueindex(2)),
                         pattern = text_at(L, lua_upvalueindex(3));
  auto from = static_cast<std::size_t>(lua_tointeger(L, lua_upvalueindex(4)));
  const lua_Integer last = lua_tointeger(L, lua_upvalueindex(5));
  for (; from <= text.size(); ++from) {
    const auto found = charged(
        L, [&](PatternSteps& steps) { return match_pattern_at(text, pattern, from, steps); });
    // An empty match where the last one ended would come again for ever.
    if (!found || static_cast<lua_Integer>(found->end) == last) continue;
    lua_pushinteger(L, static_cast<lua_Integer>(found->end));
    lua_copy(L, -1, lua_upvalueindex(4));
    lua_replace(L, lua_upvalueindex(5));
    return push_captures(L, text, *found, true);
  }
  return 0;
}

int string_gmatch(lua_State* L) {
  const std::string_view text = text_at(L, 1);
  text_at(L, 2);
  const std::size_t from = std::min(beginning(L, 3, text.size()), text.size() + 1);
  lua_settop(L, 2);
  lua_pushvalue(L, lua_upvalueindex(1));
  lua_insert(L, 1);
  lua_pushinteger(L, static_cast<lua_Integer>(from));
  lua_pushinteger(L, -1);
  lua_pushcclosure(L, next_match, 5);
  return 1;
}

/// "%1" and "%0" in the text that stands instead of a match.
void add_text(lua_State* L, std::string& made, std::string_view subject,
              const PatternMatch& found) {
  const std::string_view with = text_at(L, 3);
  for (std::size_t i = 0; i < with.size(); ++i) {
    if (with[i] != '%') {
      made += with[i];
      continue;
    }
    const char letter = ++i < with.size() ? with[i] : '\0';
    const std::size_t index = letter == '0' ? 0 : static_cast<std::size_t>(letter - '1');
    if (letter == '%') {
      made += '%';
    } else if (letter == '0' || (letter == '1' && found.captures.empty())) {
      made += subject.substr(found.begin, found.end - found.begin);
    } else if (letter < '1' || letter > '9') {
      luaL_error(L, "invalid use of '%%' in replacement string");
    } else if (index >= found.captures.size()) {
      luaL_error(L, "invalid capture index %%%c in replacement string", letter);
    } else {
      push_capture(L, subject, found.captures[index]);
      std::size_t size = 0;
      const char* const text = lua_tolstring(L, -1, &size);
      made.append(text, size);
      lua_pop(L, 1);
    }
  }
}

void push_first(lua_State* L, std::string_view subject, const PatternMatch& found) {
  if (found.captures.empty()) {
    push_captures(L, subject, found, true);
  } else {
    push_capture(L, subject, found.captures.front());
  }
}

/// What stands instead of one match.
void add_value(lua_State* L, std::string& made, std::string_view subject, const PatternMatch& found,
               int type) {
  if (type == LUA_TSTRING || type == LUA_TNUMBER) return add_text(L, made, subject, found);
  if (type == LUA_TTABLE) {
    push_first(L, subject, found);
    lua_gettable(L, 3);
  } else {
    lua_pushvalue(L, 3);
    lua_call(L, push_captures(L, subject, found, true), 1);
  }
  std::size_t size = 0;
  if (lua_toboolean(L, -1) == 0) {
    made += subject.substr(found.begin, found.end - found.begin);
  } else if (const char* const text =
                 lua_isstring(L, -1) != 0 ? lua_tolstring(L, -1, &size) : nullptr) {
    made.append(text, size);
  } else {
    luaL_error(L, "invalid replacement value (a %s)", luaL_typename(L, -1));
  }
  lua_pop(L, 1);
}

// gsub(text, pattern, with, most): the new text, and how often it was changed.
int string_gsub(lua_State* L) {
  const std::string_view text = text_at(L, 1);
  std::string_view pattern = text_at(L, 2);
  const int type = lua_type(L, 3);
  luaL_argexpected(
      L, type == LUA_TNUMBER || type == LUA_TSTRING || type == LUA_TFUNCTION || type == LUA_TTABLE,
      3, "string/function/table");
  const lua_Integer most = luaL_optinteger(L, 4, static_cast<lua_Integer>(text.size()) + 1);
  const bool held = !pattern.empty() && pattern.front() == '^';
  if (held) pattern.remove_prefix(1);
  const PatternAccount& account = account_of(L);
  std::string made;
  std::size_t at = 0, last = std::string_view::npos;
  lua_Integer count = 0;
  while (count < most) {
    const auto found =
        charged(L, [&](PatternSteps& steps) { return match_pattern_at(text, pattern, at, steps); });
    if (found && found->end != last) {
      ++count;
      const std::size_t before = made.size();
      add_value(L, made, text, *found, type);
      account.charge(L, 1 + static_cast<std::int64_t>((made.size() - before) / 64));
      at = last = found->end;
    } else if (at < text.size()) {
      made += text[at++];
    } else {
      break;
    }
    if (made.size() > account.longest())
      return luaL_error(L, "string.gsub: the text would be too long");
    if (held) break;
  }
  made += text.substr(std::min(at, text.size()));
  lua_pushlstring(L, made.data(), made.size());
  lua_pushinteger(L, count);
  return 2;
}

}  // namespace

void open_patterns(lua_State* L, const PatternAccount& account) {
  const luaL_Reg rows[] = {{"find", string_find},
                           {"match", string_match},
                           {"gmatch", string_gmatch},
                           {"gsub", string_gsub},
                           {nullptr, nullptr}};
  // Never written through: Lua has no pointers to what is constant.
  lua_pushlightuserdata(L, const_cast<PatternAccount*>(&account));
  luaL_setfuncs(L, rows, 1);
}

}  // namespace vitreo::scripted
