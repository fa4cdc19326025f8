// SPDX-License-Identifier: Apache-2.0
#include "host/lua/prompt/prompt_calls.h"

#include "host/config/config.h"
#include "host/lua/interpreter/errors.h"
#include "host/lua/interpreter/state.h"
#include "host/lua/interpreter/stop.h"
#include "host/lua/interpreter/turn.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/prompt/prompt_see.h"
#include "host/lua/prompt/prompt_show.h"
#include "host/lua/reference/reference.h"
#include "host/lua/rig/bind_rig.h"
#include "host/lua/run/classes.h"
#include "host/lua/script/protocol_files.h"
#include "host/lua/script/reading.h"
#include "host/lua/script/running.h"
#include "host/text/columns.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo::lua {
namespace {

std::string range_text(const Parameter& parameter, const std::string& dimension) {
  if (std::isinf(parameter.min)) return "at most " + format_quantity(parameter.max, dimension);
  if (std::isinf(parameter.max)) return "at least " + format_quantity(parameter.min, dimension);
  return format_range(parameter.min, parameter.max, dimension);
}

/// A value as the script has it: numbers are SI. Texts may be written with a unit, as on the
/// command line.
/// Of a list, a vector or a range: a vector, a table of numbers, or {min = a, max = b}.
std::vector<double> several_values(lua_State* L, int index, const Parameter& parameter) {
  std::vector<double> values;
  if (parameter.kind == ParameterKind::range && lua_istable(L, index)) {
    for (const char* const key : {"min", "max"}) {
      if (lua_getfield(L, index, key) == LUA_TNUMBER) values.push_back(lua_tonumber(L, -1));
      lua_pop(L, 1);
    }
  }
  if (const auto numbers = values.empty() ? to_numbers(L, index) : std::nullopt) values = *numbers;
  check_several(parameter, values);
  return values;
}

ArgumentValue parameter_value(lua_State* L, int index, const Parameter& parameter) {
  const bool number =
      parameter.kind == ParameterKind::number || parameter.kind == ParameterKind::integer;
  if (lua_type(L, index) == LUA_TSTRING) return read_argument(parameter, plain_text(L, index));
  if (parameter.kind == ParameterKind::flag && lua_isboolean(L, index))
    return lua_toboolean(L, index) != 0;
  if (is_several(parameter.kind)) return several_values(L, index, parameter);
  if (!number || lua_type(L, index) != LUA_TNUMBER)
    throw std::invalid_argument(parameter.name + ": wants " +
                                (parameter.kind == ParameterKind::flag ? "true or false"
                                 : number ? "a number in SI, such as 5 * units.um"
                                          : "a string") +
                                ", got " + kind_of(L, index));
  const double value = lua_tonumber(L, index);
  const auto unit = find_unit(parameter.unit);
  const std::string dimension(unit ? unit->dimension : "");
  if (!(value >= parameter.min && value <= parameter.max))
    throw std::invalid_argument(parameter.name + ": wants " + range_text(parameter, dimension) +
                                ", got " + format_quantity(value, dimension));
  if (parameter.kind == ParameterKind::integer && value != std::floor(value))
    throw std::invalid_argument(parameter.name + ": wants a whole number, got " +
                                plain_text(L, index));
  return value;
}

// In the registry: true when the protocol that ran in this statement has ended.
constexpr const char* kProtocolEnded = "vitreo.protocol_ended";

// A protocol waits, and so yields through these calls: each goes on in a continuation, of which
// Lua keeps only a number. That number is the address of a Prepared on the stack, which the
// userdata there keeps alive.

/// What a protocol that returned or raised an error deferred and left open is ended. A deferred
/// function may wait; where one raises an error, what is left of them is called at the statement's
/// end.
int end_protocol(lua_State* L, int, lua_KContext) {
  Context& context = context_of(L);
  lua_settop(L, 2);  // the Prepared and the error
  while (context.nested && context.deferred.size() > context.nested->deferred) {
    const int reference = context.deferred.back();
    context.deferred.pop_back();
    lua_rawgeti(L, LUA_REGISTRYINDEX, reference);
    luaL_unref(L, LUA_REGISTRYINDEX, reference);
    lua_callk(L, 0, 0, 0, end_protocol);
    lua_settop(L, 2);
  }
  return guarded(L, "run: ", [&] {
    const HostCode host(context);
    while (context.nested && context.closers.size() > context.nested->closers) {
      const auto close = std::move(context.closers.back());
      context.closers.pop_back();
      close();
    }
    lua_pushboolean(L, 1);
    lua_setfield(L, LUA_REGISTRYINDEX, kProtocolEnded);
    return 0;
  });
}

/// The protocol's `__close`: it ends with its call, however that ends, and not with the statement,
/// so that the next one begins on a rig that nothing holds. After a stop the statement's end does
/// it.
int close_protocol(lua_State* L) { return is_stop(L, 2) ? 0 : end_protocol(L, LUA_OK, 0); }

/// Whether the protocol that ran in this statement has ended, so that another may run.
bool protocol_ended(lua_State* L) {
  lua_getfield(L, LUA_REGISTRYINDEX, kProtocolEnded);
  const bool ended = lua_toboolean(L, -1) != 0;
  lua_pop(L, 1);
  return ended;
}

/// The table that the file returned is on top: [.., table] -> [.., table, run, rig, p, run's
/// handle], ready for a call with three arguments.
int begin_protocol(lua_State* L, int, lua_KContext at) {
  const auto& [protocol, arguments] =
      *reinterpret_cast<std::pair<ProtocolDescription, std::map<std::string, ArgumentValue>>*>(at);
  return guarded(L, "", [&] {
    if (!lua_istable(L, -1)) throw ScriptError(protocol.file + ": a protocol returns a table");
    lua_getfield(L, -1, "run");
    push_rig(L, context_of(L).session->rig);
    push_parameters(L, protocol, arguments);
    push_run(L);
    return 1;
  });
}

using Prepared = std::pair<ProtocolDescription, std::map<std::string, ArgumentValue>>;

int collect_prepared(lua_State* L) {
  static_cast<Prepared*>(lua_touserdata(L, 1))->~Prepared();
  return 0;
}

int protocol_returned(lua_State*, int, lua_KContext) { return 0; }

/// After the file's own statements: calls the function `run` of the table that it returned.
int run_loaded(lua_State* L, int status, lua_KContext at) {
  begin_protocol(L, status, at);
  lua_callk(L, 3, 0, 0, protocol_returned);
  return protocol_returned(L, LUA_OK, 0);
}

/// run("drift_test", {hold = 5 * s}): here and now, on this rig, into this record.
/// What is prepared must outlive a yield of the protocol, which leaves this function by an
/// exception and takes its locals along: it lies in a userdata on the stack.
int run_by_name(lua_State* L) {
  Prepared* prepared = nullptr;
  guarded(L, "run: ", [&]() -> int {
    Context& context = context_of(L);
    const HostCode host(context);
    if (lua_type(L, 2) != LUA_TSTRING)
      throw std::invalid_argument("wants a protocol's name, such as run(\"hello_rig\"), got " +
                                  kind_of(L, 2));
    // A protocol that calls run() itself, or a task beside it, has not ended.
    if (context.nested && !protocol_ended(L))
      throw std::runtime_error("a protocol runs already in this statement");
    ProtocolDescription protocol = named_protocol(context, plain_text(L, 2));
    check_roles(protocol, context.session->rig);
    auto values = given_parameters(L, 3, protocol);
    // What is deferred and opened from here on ends with the protocol, not with the session.
    context.nested = {context.deferred.size(), context.closers.size()};
    lua_pushboolean(L, 0);
    lua_setfield(L, LUA_REGISTRYINDEX, kProtocolEnded);
    context.dead_time = 0;  // this run's, as every result that is shown at its end
    lua_newtable(L);
    lua_setfield(L, LUA_REGISTRYINDEX, kStatedResults);
    context.session->recorder.event(context.session->clock.now(), "protocol", protocol.file);
    context.session->recorder.module({protocol.name, protocol.file, protocol.text});
    lua_settop(L, 0);
    prepared = new (lua_newuserdatauv(L, sizeof(Prepared), 0))
        Prepared{std::move(protocol), std::move(values)};
    lua_createtable(L, 0, 2);
    lua_pushcfunction(L, collect_prepared);
    lua_setfield(L, -2, "__gc");
    lua_pushcfunction(L, close_protocol);
    lua_setfield(L, -2, "__close");
    lua_setmetatable(L, -2);
    lua_toclose(L, 1);
    load_text(L, prepared->first.text, prepared->first.file);
    return 0;
  });
  const auto at = reinterpret_cast<lua_KContext>(prepared);
  lua_callk(L, 0, 1, at, run_loaded);
  return run_loaded(L, LUA_OK, at);
}

/// The methods of a handle that only tell something: no arguments, a result, and they do not wait.
/// info and prescription tell what never changes, and would fill the line.
int getters(lua_State* L) {
  return guarded(L, "watch: ", [L]() -> int {
    const Class* const kind = handle_class(L, 1);
    if (kind == nullptr)
      throw std::invalid_argument("wants an object such as rig.stage, or a function, got " +
                                  kind_of(L, 1));
    lua_newtable(L);
    for (const Binding& row : kind->methods) {
      const bool tells = row.arguments.empty() && !row.returns.type.empty() &&
                         find_class(*context_of(L).library, row.returns.type) == nullptr;
      if (!tells || row.name == "info" || row.name == "prescription") continue;
      lua_pushstring(L, row.name.c_str());
      lua_rawseti(L, -2, static_cast<lua_Integer>(lua_rawlen(L, -2)) + 1);
    }
    if (lua_rawlen(L, -1) == 0)
      throw std::invalid_argument("a " + kind->name + " has nothing that could be followed");
    return 1;
  });
}

/// (value, call's name or nil): as people read it.
int shown(lua_State* L) {
  return guarded(L, "watch: ", [L]() -> int {
    lua_settop(L, 1);
    const std::string text = show_value(L, 1, context_of(L).last_result);
    lua_pushlstring(L, text.data(), text.size());
    return 1;
  });
}

constexpr const char* kWatch = R"(
local getters, shown, run, say, interactive = ...
return function(object, options)
  options = options or {}
  for name in pairs(options) do
    if name ~= "every" and name ~= "count" then
      error("watch: " .. name .. " is not known; it takes every and count", 2)
    end
  end
  local names = type(object) ~= "function" and getters(object) or nil
  local count = options.count or (interactive and math.huge or 1)
  local turn = 0
  while turn < count do
    turn = turn + 1
    local line = {}
    if names then
      local heard, problem
      for _, name in ipairs(names) do
        -- a robot that is not seen now may be at the next look
        local told, value = pcall(object[name], object)
        local text = told and shown(value) or "–"
        if told then heard = true else problem = problem or value end
        -- what fills several lines is asked for by its name; here each look is one, and has of a
        -- status what it does and where to
        if name == "status" and told then
          for _, field in ipairs { "state", "target" } do
            local said = text:match("\n  " .. field .. " = ([^\n]+),\n")
            if said then line[#line + 1] = field .. " " .. said end
          end
        elseif not text:find("\n", 1, true) then
          line[#line + 1] = name .. " " .. text
        end
      end
      if not heard then error(problem, 0) end
    else
      line[1] = shown(object())
    end
    say(table.concat(line, "  "))
    if turn < count then run:wait(options.every or 0.5) end
  end
end)";

/// Below the globals that there are: a unit by its bare name, else what open_strictness says.
int unit_or_undefined(lua_State* L) {
  lua_pushvalue(L, 2);
  if (lua_type(L, 2) == LUA_TSTRING && lua_rawget(L, lua_upvalueindex(1)) != LUA_TNIL) return 1;
  lua_settop(L, 2);
  lua_pushvalue(L, lua_upvalueindex(2));
  lua_insert(L, 1);
  lua_call(L, 2, 1);
  return 1;
}

/// The globals' own metatable is changed, not replaced: what is neither a unit nor defined has
/// still the error with a suggestion.
void open_units(lua_State* L) {
  push_units(L);
  lua_pushvalue(L, -1);
  lua_setglobal(L, "units");
  lua_pushglobaltable(L);
  lua_getmetatable(L, -1);
  lua_pushvalue(L, -3);
  lua_getfield(L, -2, "__index");
  lua_pushcclosure(L, unit_or_undefined, 2);
  lua_setfield(L, -2, "__index");
  lua_pop(L, 3);
}

}  // namespace

ProtocolDescription named_protocol(const Context& context, const std::string& name) {
  if (const std::string file = find_protocol(context, name); !file.empty())
    return describe_protocol(*context.library, file, context.folders);
  const std::vector<std::string> known = protocol_names(context);
  const std::string near = nearest(name, known);
  throw std::invalid_argument("there is no protocol '" + name + "'" +
                              (near.empty() ? "" : "; did you mean " + near + "?"));
}

// All keys are looked at before any value: a misspelt name is told as such, not as one that is
// missing.
std::map<std::string, ArgumentValue> given_parameters(lua_State* L, int table,
                                                      const ProtocolDescription& protocol) {
  std::map<std::string, ArgumentValue> values;
  std::vector<std::string> known;
  for (const Parameter& parameter : protocol.parameters) known.push_back(parameter.name);
  if (!lua_isnoneornil(L, table)) {
    if (!lua_istable(L, table))
      throw std::invalid_argument("wants a table of parameters, such as {hold = 5 * s}, got " +
                                  kind_of(L, table));
    refuse_unknown(L, table, "", known);
    for (const Parameter& parameter : protocol.parameters) {
      if (lua_getfield(L, table, parameter.name.c_str()) != LUA_TNIL)
        values[parameter.name] = parameter_value(L, lua_gettop(L), parameter);
      lua_pop(L, 1);
    }
  }
  for (const Parameter& parameter : protocol.parameters)
    if (parameter.required && !values.contains(parameter.name))
      throw std::invalid_argument(parameter.name + ": is missing");
  return values;
}

void check_roles(const ProtocolDescription& protocol, const Rig& rig) {
  for (const std::string& role : protocol.needs)
    if (!rig.has(role))
      throw std::invalid_argument(
          protocol.name + " needs the role '" + role + "', which this rig has not" +
          (protocol.rig.empty() ? "" : "; the rig " + protocol.rig + " has it"));
}

// run is a handle with methods and a function: __call stands in the metatable of its class, which
// this state has for itself.
void open_prompt_calls(lua_State* L) {
  push_rig(L, context_of(L).session->rig);
  lua_setglobal(L, "rig");
  push_run(L);
  lua_setglobal(L, "run");
  luaL_getmetatable(L, run_class().name.c_str());
  lua_pushcfunction(L, run_by_name);
  lua_setfield(L, -2, "__call");
  lua_pop(L, 1);
  open_units(L);
  open_globals(L, prompt_functions());
  load_text(L, kWatch, "watch");
  lua_pushcfunction(L, getters);
  lua_pushcfunction(L, shown);
  push_run(L);
  lua_getglobal(L, "print");
  lua_pushboolean(L, context_of(L).session->real_time);
  lua_call(L, 5, 1);
  lua_setglobal(L, "watch");
  open_follow(L);
}

}  // namespace vitreo::lua
