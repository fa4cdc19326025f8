// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/table_reader.h"

#include "devices/links/printable.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace vitreo::scripted {
namespace {

/// Entries of one list: a file that computes them must not fill the memory of the host.
constexpr std::size_t kMostEntries = 1000;
constexpr std::size_t kLongestText = 4096;  // bytes

}  // namespace

TableReader::TableReader(Sandbox& sandbox, std::string path)
    : sandbox_(&sandbox), table_(sandbox.stack()), path_(std::move(path)) {}

std::string TableReader::name_of(const std::string& key) const {
  const std::string shown = printable(key, 80);
  return path_.empty() ? shown : key.empty() ? path_ : path_ + "." + shown;
}

void TableReader::fail(const std::string& key, const std::string& problem) const {
  throw ScriptFault(sandbox_->file() + ": " + name_of(key) + ": " + problem);
}

// Raw: a metatable of the file's does not run here.
int TableReader::push(const std::string& key) {
  lua_State* const L = sandbox_->stack();
  // What is asked for is what is known: finish() needs no list of keys beside the code.
  known_.insert(key);
  table_.push();
  lua_pushlstring(L, key.data(), key.size());
  const int type = lua_rawget(L, -2);
  lua_remove(L, -2);
  return type;
}

bool TableReader::has(const std::string& key) {
  const int type = push(key);
  lua_pop(sandbox_->stack(), 1);
  return type != LUA_TNIL;
}

std::optional<QuantityValue> TableReader::value(const std::string& key) {
  lua_State* const L = sandbox_->stack();
  std::optional<QuantityValue> found;
  const int type = push(key);
  if (type == LUA_TBOOLEAN) found = lua_toboolean(L, -1) != 0;
  if (type == LUA_TNUMBER && std::isfinite(lua_tonumber(L, -1)))
    found = static_cast<double>(lua_tonumber(L, -1));
  if (type == LUA_TSTRING) found = std::string(lua_tostring(L, -1), lua_rawlen(L, -1));
  lua_pop(L, 1);
  if (type != LUA_TNIL && !found) fail(key, "must be a finite number, a text, true or false");
  if (found && std::holds_alternative<std::string>(*found) &&
      std::get<std::string>(*found).size() > kLongestText)
    fail(key, "is too long");
  return found;
}

std::optional<std::string> TableReader::text(const std::string& key) {
  const auto found = value(key);
  if (!found) return std::nullopt;
  if (!std::holds_alternative<std::string>(*found)) fail(key, "must be a text");
  return std::get<std::string>(*found);
}

std::string TableReader::text(const std::string& key, const std::string& fallback) {
  return text(key).value_or(fallback);
}

std::optional<double> TableReader::number(const std::string& key, double min, double max) {
  const auto found = value(key);
  if (!found) return std::nullopt;
  const double* const number = std::get_if<double>(&*found);
  if (number == nullptr || std::isnan(*number)) fail(key, "must be a number");
  if (*number < min || *number > max) {
    const auto shown = [](double bound) {
      std::string digits = std::to_string(bound);
      digits.erase(digits.find_last_not_of('0') + 1);
      if (digits.back() == '.') digits.pop_back();
      return digits;
    };
    fail(key, "must be " + shown(min) + " to " + shown(max));
  }
  return *number;
}

bool TableReader::flag(const std::string& key, bool fallback) {
  const auto found = value(key);
  if (!found) return fallback;
  if (!std::holds_alternative<bool>(*found)) fail(key, "must be true or false");
  return std::get<bool>(*found);
}

Action TableReader::action(const std::string& key) {
  lua_State* const L = sandbox_->stack();
  const int type = push(key);
  if (type == LUA_TFUNCTION) return Reference(L);
  lua_pop(L, 1);
  if (type == LUA_TNIL) return {};
  if (type != LUA_TSTRING) fail(key, "must be a message (a text), or a function");
  return *text(key);
}

Reference TableReader::function(const std::string& key) {
  const Action found = action(key);
  if (std::holds_alternative<std::string>(found)) fail(key, "must be a function");
  const Reference* const reference = std::get_if<Reference>(&found);
  return reference == nullptr ? Reference() : *reference;
}

std::vector<std::string> TableReader::texts(const std::string& key) {
  lua_State* const L = sandbox_->stack();
  const int type = push(key);
  if (type == LUA_TNIL) return lua_pop(L, 1), std::vector<std::string>{};
  if (type == LUA_TSTRING) return lua_pop(L, 1), std::vector<std::string>{*text(key)};
  std::vector<std::string> found;
  bool good = type == LUA_TTABLE;
  const lua_Integer count = good ? static_cast<lua_Integer>(lua_rawlen(L, -1)) : 0;
  good = good && count <= static_cast<lua_Integer>(kMostEntries);
  for (lua_Integer i = 1; good && i <= count; ++i) {
    good = lua_rawgeti(L, -1, i) == LUA_TSTRING && lua_rawlen(L, -1) <= kLongestText;
    if (good) found.emplace_back(lua_tostring(L, -1), lua_rawlen(L, -1));
    lua_pop(L, 1);
  }
  lua_pop(L, 1);
  if (!good) fail(key, "must be a text, or a list of texts");
  return found;
}

std::vector<double> TableReader::numbers(const std::string& key) {
  lua_State* const L = sandbox_->stack();
  const int type = push(key);
  if (type == LUA_TNIL) return lua_pop(L, 1), std::vector<double>{};
  std::vector<double> found;
  bool good = type == LUA_TTABLE;
  const lua_Integer count = good ? static_cast<lua_Integer>(lua_rawlen(L, -1)) : 0;
  good = good && count <= static_cast<lua_Integer>(kMostEntries);
  for (lua_Integer i = 1; good && i <= count; ++i) {
    good = lua_rawgeti(L, -1, i) == LUA_TNUMBER && std::isfinite(lua_tonumber(L, -1));
    if (good) found.push_back(lua_tonumber(L, -1));
    lua_pop(L, 1);
  }
  lua_pop(L, 1);
  if (!good) fail(key, "must be a list of numbers");
  return found;
}

std::optional<TableReader> TableReader::table(const std::string& key) {
  lua_State* const L = sandbox_->stack();
  const int type = push(key);
  if (type == LUA_TTABLE) return TableReader(*sandbox_, name_of(key));
  lua_pop(L, 1);
  if (type != LUA_TNIL) fail(key, "must be a table");
  return std::nullopt;
}

std::vector<TableReader> TableReader::list(const std::string& key) {
  lua_State* const L = sandbox_->stack();
  std::vector<TableReader> found;
  const int type = push(key);
  if (type == LUA_TNIL) return lua_pop(L, 1), found;
  bool good = type == LUA_TTABLE;
  const lua_Integer count = good ? static_cast<lua_Integer>(lua_rawlen(L, -1)) : 0;
  good = good && count <= static_cast<lua_Integer>(kMostEntries);
  for (lua_Integer i = 1; good && i <= count; ++i) {
    good = lua_rawgeti(L, -1, i) == LUA_TTABLE;
    if (good) {
      found.emplace_back(*sandbox_, name_of(key) + "[" + std::to_string(i) + "]");
    } else {
      lua_pop(L, 1);
    }
  }
  lua_pop(L, 1);
  if (!good) fail(key, "must be a list of tables");
  return found;
}

// Sorted, as the order of Lua's tables changes from run to run: quantities keep their indices.
std::vector<std::string> TableReader::keys() {
  lua_State* const L = sandbox_->stack();
  std::vector<std::string> found;
  table_.push();
  lua_pushnil(L);
  while (lua_next(L, -2) != 0) {
    if (lua_type(L, -2) == LUA_TSTRING && found.size() <= kMostEntries)
      found.emplace_back(lua_tostring(L, -2), lua_rawlen(L, -2));
    lua_pop(L, 1);
  }
  lua_pop(L, 1);
  if (found.size() > kMostEntries) fail("", "has too many entries");
  std::sort(found.begin(), found.end());
  return found;
}

std::optional<int> TableReader::whole(const std::string& key, int min, int max) {
  const auto found = number(key, min, max);
  if (found && *found != std::floor(*found)) fail(key, "must be a whole number");
  return found ? std::optional(static_cast<int>(*found)) : std::nullopt;
}

Time TableReader::seconds(const std::string& key, double fallback, double most) {
  return from_seconds(number(key, 0, most).value_or(fallback));
}

void TableReader::finish() {
  for (const std::string& key : keys())
    if (!known_.contains(key)) {
      std::string all;
      for (const std::string& known : known_) all += (all.empty() ? "" : ", ") + known;
      fail(key, "is not known here; known are: " + all);
    }
}

}  // namespace vitreo::scripted
