// A Lua state with its sandbox: fresh for each run.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/context.h"

#include <lua.hpp>

#include <memory>
#include <string>
#include <vector>

namespace vitreo::lua {

struct Binding;
struct Library;

constexpr std::size_t kMemoryLimit = 256u << 20;  // bytes, of one state

class State {
 public:
  /// Null session: files are only read. The library is borrowed. Throws std::bad_alloc.
  State(const Library& library, Session* session, const std::vector<std::string>& folders);
  ~State();
  State(const State&) = delete;
  State& operator=(const State&) = delete;
  lua_State* main() const { return context_.main; }
  Context& context() { return context_; }

 private:
  Context context_;
};

/// The parts of the sandbox; each works on globals of a state whose standard libraries are open.
void open_guards(lua_State* L);      // pcall, xpcall, setmetatable, load
void open_coroutines(lua_State* L);  // coroutine.*
void open_order(lua_State* L);       // pairs, next, tostring, string.format, print
void open_time(lua_State* L);        // os.*, math.random
void open_modules(lua_State* L);     // require
void open_long_calls(lua_State* L);  // of string, table, utf8: those whose C code can take long
void open_strictness(lua_State* L);  // reading an undefined global is an error
void push_units(lua_State* L);
/// What require(name) gives: [value] -> [].
void set_module(lua_State* L, const std::string& name);
/// The rows "optics.trace" or "vision.color_model.train" as functions of the table `name`, which is
/// global and what require(name) gives. To read what is not there is an error that proposes what
/// may be meant.
void open_functions(lua_State* L, const std::string& name, const std::vector<Binding>& rows);

/// Loads text; leaves the function on the stack. Throws ScriptError with file and line.
void load_text(lua_State* L, const std::string& text, const std::string& file);
/// The file's text. Throws ScriptError.
std::string read_text_file(const std::string& file);

}  // namespace vitreo::lua
