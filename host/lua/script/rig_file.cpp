// Rig files: data that is written, or computed, in Lua, turned into plain data.
// SPDX-License-Identifier: Apache-2.0
#include "host/config/config_base.h"
#include "host/config/config_lines.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/errors.h"
#include "host/lua/interpreter/state.h"
#include "host/lua/interpreter/stop.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/script/reading.h"
#include "host/lua/script/rig_environment.h"

#include <algorithm>
#include <cmath>
#include <filesystem>

namespace vitreo::lua {
namespace {

namespace fs = std::filesystem;

constexpr int kMaxDepth = 16;  // of tables in tables; one that holds itself has no end

/// Lua values as plain data. A table is a list or has names: an empty one has names.
class Converter {
 public:
  Converter(lua_State* state, const RigDescription& rig) : L(state), rig_(rig) {}

  ConfigTable table(int index, const std::string& path, int depth) {
    if (depth > kMaxDepth) fail(path, "holds tables in tables without end");
    ConfigTable result;
    push_sorted_keys(L, index);
    const int keys = lua_gettop(L);
    for (lua_Integer i = 1; i <= static_cast<lua_Integer>(lua_rawlen(L, keys)); ++i) {
      lua_rawgeti(L, keys, i);
      if (lua_type(L, -1) != LUA_TSTRING)
        fail(path, "mixes a list with named values, or has a list with gaps");
      const std::string key = lua_tostring(L, -1);
      lua_rawget(L, index);
      result[key] = value(lua_gettop(L), path.empty() ? key : path + "." + key, depth);
      lua_pop(L, 1);
    }
    lua_settop(L, keys - 1);
    return result;
  }

 private:
  ConfigValue value(int index, const std::string& path, int depth) {
    luaL_checkstack(L, 20, "too deep");
    switch (lua_type(L, index)) {
      case LUA_TBOOLEAN:
        return {static_cast<bool>(lua_toboolean(L, index))};
      case LUA_TNUMBER:
        if (!std::isfinite(lua_tonumber(L, index))) fail(path, "is not a finite number");
        return {static_cast<double>(lua_tonumber(L, index))};
      case LUA_TSTRING:
        return {std::string(lua_tostring(L, index))};
      case LUA_TTABLE:
        if (lua_rawlen(L, index) > 0) return {list(index, path, depth + 1)};
        return {table(index, path, depth + 1)};
      default:
        fail(path, "is " + kind_of(L, index) +
                       ": a rig file holds numbers, strings, true, false and tables");
    }
  }

  ConfigList list(int index, const std::string& path, int depth) {
    if (depth > kMaxDepth) fail(path, "holds tables in tables without end");
    const auto count = static_cast<lua_Integer>(lua_rawlen(L, index));
    push_sorted_keys(L, index);
    const bool only_list = static_cast<lua_Integer>(lua_rawlen(L, -1)) == count;
    lua_pop(L, 1);
    if (!only_list) fail(path, "mixes a list with named values, or has a list with gaps");
    ConfigList result;
    for (lua_Integer i = 1; i <= count; ++i) {
      if (lua_rawgeti(L, index, i) == LUA_TNIL) fail(path, "has a list with gaps");
      result.push_back(value(lua_gettop(L), path + "." + std::to_string(i), depth));
      lua_pop(L, 1);
    }
    return result;
  }

  [[noreturn]] void fail(const std::string& path, const std::string& problem) const {
    const int line = path.empty() ? 0 : find_line(rig_.text, path);
    throw ScriptError(rig_.file + ":" + (line > 0 ? std::to_string(line) + ":" : "") + " " +
                      (path.empty() ? "the rig" : path) + " " + problem);
  }

  lua_State* const L;
  const RigDescription& rig_;
};

/// With the line at which the reading was given up.
std::string too_long(const Context& context, const std::string& file) {
  const std::string place = context.stopped_at.empty() ? file + ": " : context.stopped_at;
  return place + "the file takes too long to read: is there a loop without an end?";
}

/// A rig is some pages long; one of megabytes would be read for seconds before it is refused.
constexpr std::size_t kLongestRig = 1 << 20;  // bytes

/// One file, without what it builds on. Throws ScriptError with file and line.
RigDescription read_alone(const Library& library, const RigSource& source) {
  RigDescription rig;
  rig.file = source.file, rig.text = source.text;
  const std::string& file = rig.file;
  if (rig.text.size() > kLongestRig)
    throw ScriptError(file + ": is longer than a rig file may be: 1 MB");
  State state(library, nullptr, {});
  lua_State* const L = state.main();
  try {
    in_lua(L, 0, [&] {
      load_text(L, rig.text, file);
      push_rig_environment(L);
      lua_setupvalue(L, -2, 1);
      state.context().running = L;  // for the line of an error of the memory
      arm_reading_limit(L);
      lua_call(L, 0, 1);
      lua_sethook(L, nullptr, 0, 0);
      if (!lua_istable(L, -1))
        throw ScriptError(file + ": a rig file returns a table, this one returns " +
                          kind_of(L, -1));
      rig.table = Converter(L, rig).table(lua_gettop(L), "", 0);
      lua_settop(L, 0);
    });
  } catch (const Stopped&) {
    throw ScriptError(too_long(state.context(), file));
  }
  return rig;
}

/// With the line of the key `base`, where it is found.
[[noreturn]] void refuse_base(const RigDescription& rig, const std::string& problem) {
  const int line = find_line(rig.text, "base");
  throw ScriptError(rig.file + ":" + (line > 0 ? std::to_string(line) + ":" : "") + " base " +
                    problem);
}

/// The names of the rigs that lie in a folder.
void add_names(const fs::path& folder, std::vector<std::string>& names) {
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error))
    if (entry.path().extension() == ".lua") names.push_back(entry.path().stem().string());
}

/// A name is looked for beside the file first, then among the program's own rigs; what ends in .lua
/// is a file's path, from where this one stands.
std::string find_base(const RigDescription& rig, const std::string& name,
                      const std::vector<std::string>& folders) {
  const fs::path beside = fs::path(rig.file).parent_path();
  if (name.ends_with(".lua")) {
    if (fs::is_regular_file(beside / name)) return (beside / name).lexically_normal().string();
    refuse_base(rig,
                "names a file that is not there: " + (beside / name).lexically_normal().string());
  }
  std::vector<fs::path> places{beside};
  for (const std::string& folder : folders) places.push_back(fs::path(folder) / "rigs");
  std::vector<std::string> names;
  for (const fs::path& place : places) {
    const fs::path found = (place / (name + ".lua")).lexically_normal();
    std::error_code error;
    if (fs::is_regular_file(found, error) && !fs::equivalent(found, rig.file, error))
      return found.string();
    add_names(place, names);
  }
  const std::string near = nearest(name, names);
  refuse_base(rig, "names a rig that is neither beside this file nor among the program's own: " +
                       name + (near.empty() ? "" : "; did you mean " + near + "?"));
}

/// `chain`: the files on the way here, which must not come again.
RigDescription read_with_bases(const Library& library, const std::string& file,
                               const std::vector<std::string>& folders,
                               std::vector<std::string>& chain) {
  RigDescription rig = read_alone(library, {file, read_text_file(file)});
  const auto base = rig.table.find("base");
  if (base == rig.table.end()) return rig;
  const auto* const name = std::get_if<std::string>(&base->second.value);
  if (name == nullptr || name->empty())
    refuse_base(rig, "wants a rig's name, such as \"simulated\", or a file's");
  chain.push_back(fs::weakly_canonical(file).string());
  const std::string below = find_base(rig, *name, folders);
  if (std::find(chain.begin(), chain.end(), fs::weakly_canonical(below).string()) != chain.end())
    refuse_base(rig, "goes in a circle: " + below + " builds on this file itself");
  RigDescription under = read_with_bases(library, below, folders, chain);
  rig.table.erase("base");
  build_on(rig, std::move(under));
  return rig;
}

}  // namespace

RigDescription read_rig_file(const Library& library, const std::string& file,
                             const std::vector<std::string>& folders) {
  std::vector<std::string> chain;
  RigDescription rig = read_with_bases(library, file, folders, chain);
  rig.folders = folders;
  return rig;
}

// From the undermost base upwards: each file overrides what it builds on. The texts are those of
// the record; files of today may say something else.
RigDescription read_recorded_rig(const Library& library, const RigSource& rig,
                                 const std::vector<RigSource>& bases) {
  RigDescription whole = read_alone(library, bases.empty() ? rig : bases.back());
  whole.table.erase("base");
  for (std::size_t i = bases.size(); i-- > 0;) {
    RigDescription nearer = read_alone(library, i > 0 ? bases[i - 1] : rig);
    nearer.table.erase("base");
    build_on(nearer, std::move(whole));
    whole = std::move(nearer);
  }
  return whole;
}

}  // namespace vitreo::lua
