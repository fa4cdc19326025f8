// The prompt: statements and expressions, one after the other, in one state.
// SPDX-License-Identifier: Apache-2.0
#include "devices/error.h"
#include "host/lua/bind_rig.h"
#include "host/lua/errors.h"
#include "host/lua/running.h"
#include "host/lua/values.h"

#include <istream>
#include <ostream>
#include <poll.h>
#include <unistd.h>

namespace vitreo::lua {
namespace {

enum class Loaded { yes, incomplete, no };

/// As an expression first, then as statements; the function, or the message, is on the stack.
Loaded load_chunk(lua_State* L, const std::string& chunk) {
  const std::string expression = "return " + chunk;
  if (luaL_loadbufferx(L, expression.data(), expression.size(), "=prompt", "t") == LUA_OK) return Loaded::yes;
  lua_pop(L, 1);
  if (luaL_loadbufferx(L, chunk.data(), chunk.size(), "=prompt", "t") == LUA_OK) return Loaded::yes;
  return std::string_view(lua_tostring(L, -1)).ends_with("<eof>") ? Loaded::incomplete : Loaded::no;
}

void show_results(lua_State* L, int count, std::ostream& out) {
  std::string line;
  in_lua(L, count, [&] {
    for (int i = 1; i <= count; ++i) line += (i > 1 ? "\t" : "") + pretty(L, i);
    lua_settop(L, 0);
  });
  if (count > 0) out << line << '\n';
}

void execute(ScriptRun& script, std::ostream& out) {
  RunControl& control = script.context().session->control;
  control.set_idle(false);
  try {
    show_results(script.main(), script.scheduler().run(0), out);
  } catch (const Stopped&) {
    out << (control.tier() >= StopTier::abort ? "aborted; the devices are safe\n" : "stopped\n");
  } catch (const std::exception& error) {
    out << "error: " << error.what() << '\n';
  }
  control.set_idle(true);
  script.scheduler().unlimit_waits();
  script.context().interrupted = false;
  script.context().laps.clear();
  script.context().trace.clear();
  out.flush();
}

/// Takes one line into `chunk`; runs it when it is complete.
void take_line(ScriptRun& script, std::string& chunk, const std::string& line, std::ostream& out) {
  chunk += (chunk.empty() ? "" : "\n") + line;
  if (chunk.find_first_not_of(" \t\r\n") == std::string::npos) return chunk.clear();
  lua_State* const L = script.main();
  Loaded loaded = Loaded::no;
  try {
    in_lua(L, 0, [&] { loaded = load_chunk(L, chunk); });
  } catch (const std::exception& error) {
    out << "error: " << error.what() << '\n';
    return chunk.clear();
  }
  if (loaded == Loaded::incomplete) return lua_settop(L, 0);
  if (loaded == Loaded::yes)
    execute(script, out);
  else
    out << "error: " << lua_tostring(L, -1) << std::endl;
  lua_settop(L, 0);
  chunk.clear();
}

/// While somebody thinks, the loop goes on holding the robot.
void wait_for_line(Clock& clock, std::istream& in) {
  pollfd input{STDIN_FILENO, POLLIN, 0};
  while (in.rdbuf()->in_avail() <= 0 && poll(&input, 1, 0) == 0) clock.sleep_for(std::chrono::milliseconds(20));
}

}  // namespace

void run_prompt(ScriptRun& script, std::istream& in, std::ostream& out, bool interactive) {
  lua_State* const L = script.main();
  script.context().print = [&out](const std::string& line) { out << line << std::endl; };
  in_lua(L, 0, [&] {
    push_rig(L, script.context().session->rig);
    lua_setglobal(L, "rig");
    push_run(L);
    lua_setglobal(L, "run");
    push_units(L);
    lua_setglobal(L, "units");
    lua_settop(L, 0);
  });
  std::string chunk, line;
  script.context().session->control.set_idle(true);
  const auto ask = [&] {
    if (interactive) out << (chunk.empty() ? "> " : ">> ") << std::flush;
    if (interactive && script.context().session->real_time) wait_for_line(script.context().session->clock, in);
    return static_cast<bool>(std::getline(in, line));
  };
  while (ask()) take_line(script, chunk, line, out);
  if (!chunk.empty()) {
    in_lua(L, 0, [&] { load_chunk(L, chunk); });
    out << "error: " << lua_tostring(L, -1) << std::endl;
    lua_settop(L, 0);
  }
  if (interactive) out << '\n';
  script.context().session->control.set_idle(false);
}

}  // namespace vitreo::lua
