// run: alarms, which stay until their cause is gone and somebody has acknowledged them.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/binding.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/run/classes.h"

#include <stdexcept>

namespace vitreo::lua {
namespace {

int raise(Call& call) {
  const auto priority = alarm_priority_named(call.text(1));
  if (!priority)
    throw std::invalid_argument("priority: wants low, medium or high, got " + call.text(1));
  if (call.text(0).empty()) throw std::invalid_argument("name: wants a name, got an empty one");
  session_of(call.L).raise(call.text(0), *priority, call.text(2));
  return 0;
}

int clear(Call& call) {
  Session& session = session_of(call.L);
  session.alarms.clear(call.text(0));
  session.note_alarms();
  return 0;
}

int acknowledge(Call& call) {
  Session& session = session_of(call.L);
  const int count = session.alarms.acknowledge(call.has(0) ? call.text(0) : "", "the script");
  session.note_alarms();
  lua_pushinteger(call.L, count);
  return 1;
}

int list(Call& call) {
  lua_State* const L = call.L;
  lua_newtable(L);
  lua_Integer number = 0;
  for (const Alarm& alarm : session_of(L).alarms.shown()) {
    lua_createtable(L, 0, 5);
    for (const auto& [key, text] : {std::pair<const char*, std::string>{"name", alarm.name},
                                    {"priority", to_string(alarm.priority)},
                                    {"text", alarm.text},
                                    {"acknowledged_by", alarm.acknowledged_by}}) {
      lua_pushlstring(L, text.data(), text.size());
      lua_setfield(L, -2, key);
    }
    lua_pushboolean(L, alarm.active);
    lua_setfield(L, -2, "active");
    lua_rawseti(L, -2, ++number);
  }
  return 1;
}

}  // namespace

std::vector<Binding> run_alarm_rows() {
  const Argument name{
      .name = "name", .type = Type::text, .help = "what raises it again raises the same one"};
  Argument any = name;
  any.optional = true;
  any.help = "without it: all";
  return {{"alarm",
           {name,
            {.name = "priority",
             .type = Type::text,
             .help = "high: act at once; medium: promptly; low: look at it"},
            {.name = "text", .type = Type::text}},
           "",
           "raises an alarm: it is shown, recorded, and stays until it is cleared and acknowledged",
           raise},
          {"clear_alarm", {name}, "", "the cause of an alarm is gone", clear},
          {"acknowledge",
           {any},
           "number",
           "says that somebody knows of the alarms; returns of how many",
           acknowledge},
          {"alarms",
           {},
           "list",
           "those that stand: name, priority, text, active, acknowledged_by",
           list}};
}

}  // namespace vitreo::lua
