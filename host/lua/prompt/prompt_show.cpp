// SPDX-License-Identifier: Apache-2.0
#include "host/lua/prompt/prompt_show.h"

#include "host/lua/interpreter/values.h"
#include "host/lua/reference/reference.h"
#include "host/lua/rig/bind_rig.h"
#include "host/lua/rig/classes.h"
#include "host/session/session.h"
#include "host/text/terminal_text.h"

#include <fstream>
#include <sstream>

namespace vitreo::lua {
namespace {

constexpr std::size_t kLineWidth = 100;
// Frames of a trace that are shown: those of a deep recursion would all say the same.
constexpr int kFrames = 8;

/// "lib.lua:12: in function 'f'": file and line; line 0 where it is no place in a file of the
/// user's.
struct Place {
  std::string file;
  int line = 0;
};

Place place_of(const std::string& text) {
  const std::size_t colon = text.find(':');
  // A trace has [C] for functions in C++ and [string "..."] for chunks without a file.
  if (colon == std::string::npos || text.starts_with('[')) return {};
  const std::size_t end = text.find(':', colon + 1);
  const std::string number = text.substr(colon + 1, end - colon - 1);
  // Eight digits fit into an int, where std::stoi() would throw for more.
  if (number.empty() || number.size() > 8 ||
      number.find_first_not_of("0123456789") != std::string::npos)
    return {};
  return {text.substr(0, colon), std::stoi(number)};
}

/// "" for a file that is gone or shorter by now.
std::string source_line(const Place& place, const std::vector<std::string>& typed) {
  std::string line;
  if (place.file == "prompt") {
    // What was typed is in no file: the prompt keeps its lines. They count from 1.
    if (place.line <= static_cast<int>(typed.size()))
      line = typed[static_cast<std::size_t>(place.line - 1)];
  } else {
    std::ifstream file(place.file);
    for (int i = 1; i <= place.line && std::getline(file, line); ++i) {
    }
    if (!file) return "";
  }
  line.erase(0, std::min(line.find_first_not_of(" \t"), line.size()));
  return line.size() > kLineWidth ? whole_characters(line, kLineWidth) + "..." : line;
}

/// A message may quote megabytes that were typed: its two ends tell what is wrong.
std::string shortened(const std::string& message) {
  constexpr std::size_t kEnd = 500;
  if (message.size() <= 3 * kEnd) return message;
  const auto begins = [&](std::size_t at) {  // no character is cut
    // 10xxxxxx continues a character of UTF-8: the cut moves on to where the next one begins.
    while (at < message.size() && (static_cast<unsigned char>(message[at]) & 0xC0) == 0x80) ++at;
    return at;
  };
  const std::size_t head = begins(kEnd), tail = begins(message.size() - kEnd);
  return message.substr(0, head) + " ... " + std::to_string(tail - head) + " bytes ... " +
         message.substr(tail);
}

/// One pair of a table to a line, where all of it is too long for one.
std::string long_table(lua_State* L, int index, const FieldUnits& units) {
  std::string text = "{";
  // Keys are sorted, since the order of a Lua table changes from run to run; access is raw, so that
  // no __index of a script runs while its value is shown.
  push_sorted_keys(L, index);
  const int keys = lua_gettop(L);
  const auto count = static_cast<lua_Integer>(lua_rawlen(L, keys));
  constexpr lua_Integer kShown = 60;
  for (lua_Integer i = 1; i <= std::min(count, kShown); ++i) {
    lua_rawgeti(L, keys, i);
    const std::string name = lua_type(L, -1) == LUA_TSTRING ? plain_text(L, lua_gettop(L)) : "";
    text += "\n  " + (name.empty() ? "" : name + " = ");
    lua_rawget(L, index);
    text += pretty_field(L, name, lua_gettop(L), 2, units) + ",";
    lua_pop(L, 1);
  }
  if (count > kShown) text += "\n  ... " + std::to_string(count - kShown) + " more";
  lua_settop(L, keys - 1);
  return text + "\n}";
}

/// A list of tables of the same plain fields as columns, a line for each; "" where it is none.
/// Lists and tables within are no plain fields.
std::string in_columns(lua_State* L, int index, const FieldUnits& units) {
  constexpr lua_Integer kShown = 60;
  const auto count = static_cast<lua_Integer>(lua_rawlen(L, index));
  if (count < 2) return "";
  std::vector<std::string> names;
  std::vector<std::vector<std::string>> rows;
  for (lua_Integer i = 1; i <= std::min(count, kShown); ++i) {
    // A vector {x, y, z} is a table too, but one value: a list of positions has no columns.
    if (lua_rawgeti(L, index, i) != LUA_TTABLE || to_vector(L, lua_gettop(L)))
      return lua_pop(L, 1), "";
    const int row = lua_gettop(L);
    push_sorted_keys(L, row);
    const int keys = lua_gettop(L);
    std::vector<std::string> fields, cells;
    bool plain = lua_rawlen(L, keys) > 0;
    for (lua_Integer k = 1; plain && k <= static_cast<lua_Integer>(lua_rawlen(L, keys)); ++k) {
      lua_rawgeti(L, keys, k);
      plain = lua_type(L, -1) == LUA_TSTRING;
      if (plain) fields.push_back(plain_text(L, lua_gettop(L)));
      lua_rawget(L, row);
      plain = plain && (!lua_istable(L, -1) || to_vector(L, lua_gettop(L)));
      if (plain) cells.push_back(pretty_field(L, fields.back(), lua_gettop(L), 2, units));
      lua_pop(L, 1);
    }
    lua_settop(L, row - 1);
    // Fields are sorted: rows with the same names have them in the same order.
    if (!plain || (i > 1 && fields != names)) return "";
    names = std::move(fields);
    rows.push_back(std::move(cells));
  }
  rows.insert(rows.begin(), names);
  std::vector<std::size_t> widths(names.size());
  for (const auto& row : rows)
    for (std::size_t k = 0; k < row.size(); ++k)
      widths[k] = std::max(widths[k], columns_of(row[k]));
  std::string text;
  for (const auto& row : rows) {
    for (std::size_t k = 0; k < row.size(); ++k)
      text += (k > 0 ? "  " : "") + row[k] +
              (k + 1 < row.size() ? std::string(widths[k] - columns_of(row[k]), ' ') : "");
    text += "\n";
  }
  if (count > kShown) return text + "... " + std::to_string(count - kShown) + " more";
  text.pop_back();
  return text;
}

/// A handle: what it is, and what can be asked of it.
std::string handle_text(lua_State* L, const Class& kind) {
  std::vector<std::string> names;
  // A rig's fields are its roles, which differ from rig to rig and are in no list of methods.
  if (kind.name == rig_class().name) names = context_of(L).session->rig.roles();
  for (const Binding& row : kind.methods) names.push_back(row.name);
  std::string text = kind.name + ":";
  for (const std::string& name : names) {
    if (text.size() - text.rfind('\n') - 1 + name.size() > kLineWidth) text += "\n ";
    text += " " + name;
  }
  return text;
}

}  // namespace

// The value is that of the last call only if it is the very same: the same table, or the same
// number. After `x + 1` the call that gave x must not lend its unit.
std::string show_value(lua_State* L, int index, const Context::Result& from) {
  index = lua_absindex(L, index);
  if (lua_type(L, index) == LUA_TUSERDATA && luaL_getmetafield(L, index, "__name") == LUA_TSTRING) {
    const Class* const kind = find_class(*context_of(L).library, lua_tostring(L, -1));
    lua_pop(L, 1);
    if (kind != nullptr) return handle_text(L, *kind);
  }
  const bool called =
      from.call != nullptr && (lua_istable(L, index) ? lua_topointer(L, index) == from.pointer
                                                     : lua_tonumber(L, index) == from.number);
  const std::string unit = called ? unit_of_result(*from.call) : "";
  if (const auto text = unit.empty() ? std::nullopt : in_peoples_unit(L, index, unit)) return *text;
  const FieldUnits units = called ? units_of_fields(*from.call) : FieldUnits();
  if (lua_istable(L, index))
    if (std::string columns = in_columns(L, index, units); !columns.empty()) return columns;
  const std::string text = pretty(L, index, 3, units);
  const bool plain_table =
      lua_istable(L, index) && luaL_getmetafield(L, index, "__tostring") == LUA_TNIL;
  // luaL_getmetafield() pushes nothing where there is no such field: only else there is one to pop.
  if (lua_istable(L, index) && !plain_table) lua_pop(L, 1);
  return plain_table && text.size() > kLineWidth && lua_rawlen(L, index) == 0
             ? long_table(L, index, units)
             : text;
}

// Lines of the prompt's own helpers ("watch") are left out, and the line that was typed last, which
// stands right above; a place that the message names already is not repeated.
std::string show_error(const std::string& message, const std::string& trace,
                       const std::vector<std::string>& typed, int plain) {
  const auto is_plain = [plain](const Place& place) {
    return place.file == "prompt" && place.line == plain;
  };
  std::string text = "error: " + shortened(message) + "\n";
  const Place here = place_of(message);
  if (here.line > 0 && !is_plain(here))
    if (const std::string line = source_line(here, typed); !line.empty())
      text += "    " + line + "\n";
  std::istringstream frames(trace);
  int shown = 0;
  bool first = true;
  for (std::string frame; std::getline(frames, frame) && shown < kFrames;) {
    frame.erase(0, std::min(frame.find_first_not_of(" \t"), frame.size()));
    const Place place = place_of(frame);
    if (place.line == 0 || place.file == "watch") continue;
    const bool same = first && place.file == here.file && place.line == here.line;
    first = false;
    if (same || is_plain(place)) continue;
    ++shown;
    text += "  from " + place.file + ":" + std::to_string(place.line) + "\n";
    if (const std::string line = source_line(place, typed); !line.empty())
      text += "    " + line + "\n";
  }
  return text;
}

}  // namespace vitreo::lua
