// SPDX-License-Identifier: Apache-2.0
#include "host/lua/script/running.h"

#include "host/config/config.h"
#include "host/lua/interpreter/errors.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/rig/bind_rig.h"

#include <cmath>
#include <pthread.h>

namespace vitreo::lua {
namespace {

/// A list as a table, a vector as a vector, a range as a table with `min` and `max`.
void push_several(lua_State* L, const std::vector<double>& values, ParameterKind kind) {
  if (kind == ParameterKind::vector) return push_vector(L, {values[0], values[1], values[2]});
  lua_createtable(L, static_cast<int>(values.size()), 0);
  for (std::size_t i = 0; i < values.size(); ++i) {
    lua_pushnumber(L, values[i]);
    if (kind == ParameterKind::range)
      lua_setfield(L, -2, i == 0 ? "min" : "max");
    else
      lua_rawseti(L, -2, static_cast<lua_Integer>(i) + 1);
  }
}

void push_argument(lua_State* L, const ArgumentValue& value, ParameterKind kind) {
  const bool integer = kind == ParameterKind::integer;
  if (const auto* several = std::get_if<std::vector<double>>(&value))
    push_several(L, *several, kind);
  else if (const bool* flag = std::get_if<bool>(&value))
    lua_pushboolean(L, *flag);
  else if (const double* number = std::get_if<double>(&value))
    integer ? lua_pushinteger(L, static_cast<lua_Integer>(*number)) : lua_pushnumber(L, *number);
  else
    lua_pushstring(L, std::get<std::string>(value).c_str());
}

/// __index of p: a misspelt parameter is no nil that a script takes for "not given".
int unknown_parameter(lua_State* L) {
  return guarded(L, "", [L]() -> int {
    const std::string word = plain_text(L, 2), near = nearest(word, text_keys(L, 1));
    throw std::invalid_argument("the protocol has no parameter " + word +
                                (near.empty() ? "" : "; did you mean " + near + "?"));
  });
}

}  // namespace

void push_parameters(lua_State* L, const ProtocolDescription& protocol,
                     const std::map<std::string, ArgumentValue>& arguments) {
  lua_newtable(L);
  for (const Parameter& parameter : protocol.parameters) {
    const auto given = arguments.find(parameter.name);
    push_argument(L, given == arguments.end() ? parameter.fallback : given->second, parameter.kind);
    lua_setfield(L, -2, parameter.name.c_str());
  }
  lua_createtable(L, 0, 1);
  lua_pushcfunction(L, unknown_parameter);
  lua_setfield(L, -2, "__index");
  lua_setmetatable(L, -2);
}

// The thread is known before the context: a signal handler that finds the context must find whose
// Lua it is.
ScriptRun::ScriptRun(const Library& library, Running& running, Session& session,
                     const std::vector<std::string>& folders)
    : running_(running), state_(library, &session, folders), scheduler_(state_.context()) {
  context().scheduler = &scheduler_;
  context().print = [&session](const std::string& line) { session.listener.message(line); };
  running_.thread = static_cast<unsigned long>(pthread_self());
  running_.context = &context();
}

// First of all: from here on a signal finds nothing to stop.
ScriptRun::~ScriptRun() { running_.context = nullptr; }

// After an emergency stop no script is trusted: its functions are left out, and that is recorded.
// Handles are closed even so. A function is taken from the list before it runs, so that one that
// fails is not called again.
void ScriptRun::clean_up(std::size_t keep_deferred, std::size_t keep_closers) {
  std::exception_ptr first;
  const auto attempt = [&first](const std::function<void()>& step) {
    try {
      step();
    } catch (const std::exception&) {
      if (!first) first = std::current_exception();
    }
  };
  context().laps.clear();
  auto& deferred = context().deferred;
  Session& session = *context().session;
  if (session.control.tier() == StopTier::emergency && deferred.size() > keep_deferred) {
    session.recorder.event(session.clock.now(), "error",
                           "emergency stop: " + std::to_string(deferred.size() - keep_deferred) +
                               " deferred function(s) of the script were not called");
    deferred.resize(keep_deferred);
  }
  while (deferred.size() > keep_deferred) {
    const int reference = deferred.back();
    deferred.pop_back();
    lua_rawgeti(main(), LUA_REGISTRYINDEX, reference);
    luaL_unref(main(), LUA_REGISTRYINDEX, reference);
    attempt([this] { lua_pop(main(), scheduler_.run(0)); });
  }
  for (auto& closers = context().closers; closers.size() > keep_closers;) {
    const auto close = std::move(closers.back());
    closers.pop_back();
    attempt(close);
  }
  if (first) std::rethrow_exception(first);
}

// Both the file's statements and its function run as tasks of the scheduler, so that both can wait.
void run_protocol(ScriptRun& script, const ProtocolDescription& protocol,
                  const std::map<std::string, ArgumentValue>& arguments) {
  lua_State* const L = script.main();
  in_lua(L, 0, [&] { load_text(L, protocol.text, protocol.file); });
  if (script.scheduler().run(0) < 1 || !lua_istable(L, -1))
    throw ScriptError(protocol.file + ": a protocol returns a table");
  in_lua(L, 1, [&] {
    lua_getfield(L, -1, "run");
    push_rig(L, script.context().session->rig);
    push_parameters(L, protocol, arguments);
    push_run(L);
    lua_remove(L, 1);
  });
  script.scheduler().run(3);
  lua_settop(L, 0);
}

}  // namespace vitreo::lua
