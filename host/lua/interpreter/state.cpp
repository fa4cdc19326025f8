// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/state.h"

#include "host/lua/interpreter/binding.h"
#include "host/lua/interpreter/errors.h"
#include "host/lua/interpreter/library.h"
#include "host/lua/interpreter/values.h"
#include "host/session/script_engine.h"

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <new>
#include <sstream>
#include <stdexcept>

namespace vitreo::lua {
namespace {

constexpr std::uintmax_t kLargestText = 16'000'000;  // bytes

/// Lua's allocator with a cap: refusing memory makes a clean Lua error.
void* allocate(void* user, void* block, std::size_t old_size, std::size_t new_size) {
  Context& context = *static_cast<Context*>(user);
  if (!block) old_size = 0;  // for new objects Lua gives their type here
  if (new_size == 0) {
    std::free(block);
    context.memory -= old_size;
    return nullptr;
  }
  if (new_size > old_size && context.memory + (new_size - old_size) > context.memory_limit) {
    context.short_of_memory = true;
    if (lua_State* const running = context.running)
      context.where = where(running);  // no handler hears of this error
    return nullptr;
  }
  void* const moved = std::realloc(block, new_size);
  if (moved) context.memory += new_size - old_size;
  return moved;
}

void open_libraries(lua_State* L) {
  const luaL_Reg libraries[] = {{LUA_GNAME, luaopen_base},        {LUA_TABLIBNAME, luaopen_table},
                                {LUA_STRLIBNAME, luaopen_string}, {LUA_MATHLIBNAME, luaopen_math},
                                {LUA_UTF8LIBNAME, luaopen_utf8},  {nullptr, nullptr}};
  for (const luaL_Reg* library = libraries; library->func; ++library) {
    luaL_requiref(L, library->name, library->func, 1);
    lua_pop(L, 1);
  }
  for (const char* name : {"dofile", "loadfile", "collectgarbage", "warn"}) {
    lua_pushnil(L);
    lua_setglobal(L, name);
  }
  lua_getglobal(L, LUA_STRLIBNAME);
  lua_pushnil(L);
  lua_setfield(L, -2, "dump");  // bytecode
  lua_pop(L, 1);
}

}  // namespace

State::State(const Library& library, Session* session, const std::vector<std::string>& folders) {
  context_.library = &library;
  context_.session = session;
  context_.folders = folders;
  context_.seed = session ? session->seed : 0;
  context_.memory_limit = kMemoryLimit;
  lua_State* const L = lua_newstate(allocate, &context_);
  if (!L) throw std::bad_alloc();
  context_.main = L;
  *static_cast<Context**>(lua_getextraspace(L)) = &context_;  // coroutines copy it
  in_lua(L, 0, [L, &library] {
    open_libraries(L);
    open_errors(L);
    open_guards(L);
    open_coroutines(L);
    open_long_calls(L);
    open_order(L);
    open_time(L);
    open_vectors(L);
    open_modules(L);
    open_classes(L, library.classes);
    open_globals(L, *library.globals);
    for (const Module& module : library.modules) open_functions(L, module.name, *module.rows);
    open_strictness(L);
    lua_settop(L, 0);
  });
}

State::~State() { lua_close(context_.main); }

void load_text(lua_State* L, const std::string& text, const std::string& file) {
  std::string_view source = text;
  if (source.starts_with("\xEF\xBB\xBF")) source.remove_prefix(3);  // some editors' mark of UTF-8
  if (source.starts_with('#'))
    source.remove_prefix(std::min(source.find('\n'), source.size()));  // "#!": keeps the line
  const int status = luaL_loadbufferx(L, source.data(), source.size(), ("@" + file).c_str(), "t");
  if (status == LUA_OK) return;
  const std::string message = lua_tostring(L, -1);
  lua_pop(L, 1);
  throw ScriptError(message.find("attempt to load a binary chunk") == std::string::npos
                        ? message
                        : file + ": is not a text file, so it is not Lua that we read");
}

std::string read_text_file(const std::string& file) {
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(file, error);
  if (std::filesystem::is_directory(status))
    throw ScriptError(file + ": is a folder, not a Lua file");
  // A pipe is waited at for ever, and some devices have no end.
  if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status))
    throw ScriptError(file + ": is a device or a pipe, not a Lua file");
  std::ifstream in(file, std::ios::binary);
  if (!in) throw ScriptError(file + ": there is no such file, or it cannot be read");
  if (const auto size = std::filesystem::file_size(file, error); !error && size > kLargestText)
    throw ScriptError(file + ": is larger than a script may be: 16 MB");
  std::ostringstream text;
  text << in.rdbuf();
  if (in.bad()) throw ScriptError(file + ": cannot be read");
  return text.str();
}

}  // namespace vitreo::lua
