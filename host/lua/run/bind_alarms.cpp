// Bindings of run: alarms, which stay until their cause is gone and they are acknowledged.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/binding.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/tables.h"
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
  const std::vector<Alarm> shown = session_of(call.L).alarms.shown();
  return push_result_list(call, shown.size(), [&shown](ResultTable& entry, std::size_t i) {
    entry.text("name", shown[i].name)
        .text("priority", to_string(shown[i].priority))
        .text("text", shown[i].text)
        .text("acknowledged_by", shown[i].acknowledged_by)
        .flag("active", shown[i].active);
  });
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
           raise,
           "run:alarm(\"gel\", \"low\", \"the gel is warm\")"},
          {"clear_alarm",
           {name},
           "",
           "the cause of an alarm is gone",
           clear,
           "run:clear_alarm(\"gel\")"},
          {"acknowledge",
           {any},
           "number",
           "acknowledges the alarms; returns how many they were",
           acknowledge,
           "run:acknowledge(\"gel\")"},
          {"alarms",
           {},
           {"list of tables",
            {{"name", "", ""},
             {"priority", "", "low, medium or high"},
             {"text", "", ""},
             {"active", "", "whether its cause is still there"},
             {"acknowledged_by", "", "\"\" as long as it is not"}}},
           "those that stand",
           list,
           "run:alarms()"}};
}

}  // namespace vitreo::lua
