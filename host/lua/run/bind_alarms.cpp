// Bindings of run: alarms, which stay until their cause is gone and they are acknowledged.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/binding.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/run/classes.h"

#include <memory>
#include <stdexcept>

namespace vitreo::lua {
namespace {

/// What a handle `alarm` holds. There is no call that clears an alarm by its name: that the cause
/// of one of the host's (a tripped interlock, a full disk) is gone is not for a script to say.
struct RaisedAlarm {
  std::string name;
};

int raise(Call& call) {
  const std::string name = *call.text_option("name");
  if (name.empty()) throw std::invalid_argument("name: wants a name, got an empty one");
  session_of(call.L).raise(name, *alarm_priority_named(*call.text_option("priority")),
                           *call.text_option("text"));
  push_handle(call.L, alarm_class(), std::make_shared<RaisedAlarm>(RaisedAlarm{name}));
  return 1;
}

/// Again for one that is cleared: nothing.
int clear(Call& call) {
  Session& session = session_of(call.L);
  session.alarms.clear(call.self<RaisedAlarm>().name);
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
  return {{"alarm",
           {options_of(
               {{.name = "name",
                 .type = Type::text,
                 .help = "what raises it again raises the same one"},
                {.name = "priority",
                 .type = Type::text,
                 .help = "high: act at once; medium: promptly; low: look at it",
                 .choices = {"low", "medium", "high"}},
                {.name = "text", .type = Type::text, .help = "what is wrong, for the operator"}})},
           "alarm",
           "raises an alarm: it is shown, recorded, and stays until it is cleared and acknowledged",
           raise,
           "run:alarm { name = \"gel\", priority = \"low\", text = \"the gel is warm\" }"},
          {"acknowledge",
           {{.name = "name",
             .type = Type::text,
             .optional = true,
             .help = "of an alarm of the script or of the host; without it: all"}},
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
           "those that stand, the most urgent first",
           list,
           "run:alarms()"}};
}

const Class& alarm_class() {
  static const Class kind{"alarm",
                          "an alarm that the script has raised",
                          {{.name = "clear",
                            .doc = "its cause is gone; it stays until it is acknowledged, too",
                            .function = clear,
                            .example = "alarm:clear()"}},
                          {}};
  return kind;
}

}  // namespace vitreo::lua
