// Bindings of the operator's inputs (joystick, pedal) and of the lamp.
// SPDX-License-Identifier: Apache-2.0
#include "devices/roles/lamp.h"
#include "devices/roles/operator_input.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/scheduler.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/interpreter/work.h"
#include "host/lua/rig/bind_rig.h"
#include "host/lua/rig/classes.h"

#include <cstdint>
#include <memory>

namespace vitreo::lua {
namespace {

constexpr unsigned kButtons = 32;

// `pressed` has an entry for each button that is down and none for the others, so that pressed[n]
// reads as a condition. Bit 0 of the mask is button 1.
int push_state(const Call& call, const OperatorState& state) {
  ResultTable table(call);
  table.vector("translation", state.translation, "").vector("rotation", state.rotation, "");
  lua_createtable(call.L, 0, 0);
  for (unsigned button = 0; button < kButtons; ++button) {
    if ((state.pressed >> button & 1U) == 0) continue;
    lua_pushboolean(call.L, 1);
    lua_rawseti(call.L, -2, button + 1);
  }
  table.top("pressed");
  return 1;
}

int input_state(Call& call) {
  OperatorInput* const input = &call.self<OperatorInput>();
  auto state = std::make_shared<OperatorState>();
  return call.wait(work(
      call, "operator", [=] { *state = input->state(); }, from_seconds(kTalk),
      [state](Call& done) { return push_state(done, *state); }));
}

// Not a field of state(): of an input that is gone state() is an error, and this is false, because
// the loop of a dead-man has to end by itself when its pedal is unplugged, and not to fail.
int input_held(Call& call) {
  OperatorInput* const input = &call.self<OperatorInput>();
  const auto mask = 1U << (static_cast<unsigned>(call.number(0)) - 1);
  auto held = std::make_shared<bool>(false);
  return call.wait(work(
      call, "operator", [=] { *held = is_held(input, mask); }, from_seconds(kTalk),
      [held](Call& done) { return done.flag(*held); }));
}

// A part of the full current, which is a setting of the rig; no reading back: `level` is what was
// set last.
int lamp_set(Call& call) {
  Lamp* const lamp = &call.self<Lamp>();
  return call.wait(work(
      call, "lamp", [lamp, level = call.number(0)] { lamp->set_level(level); }, from_seconds(kTalk),
      [](Call&) { return 0; }));
}

int lamp_level(Call& call) { return call.result(call.self<Lamp>().level()); }

}  // namespace

const Class& operator_input_class() {
  static const Class kind{
      "operator_input",
      "a joystick (rig.joystick) or pedals (rig.pedal)",
      {{"state",
        {},
        {"table",
         {{"translation", "", "{x, y, z} of full deflection"},
          {"rotation", "", "{x, y, z} of full deflection"},
          {"pressed", "", "[n] is true while button n is down"}}},
        "what the operator does now; an error when the input is gone",
        input_state,
        "rig.joystick:state()"},
       {"held",
        {{.name = "button", .type = Type::integer, .min = 1, .max = kButtons, .help = "from 1"}},
        "true or false",
        "whether button or pedal n is down, for a dead-man: false too when the input is gone",
        input_held,
        "rig.pedal:held(2)"}}};
  return kind;
}

const Class& lamp_class() {
  static const Class kind{"lamp",
                          "a lamp that can be dimmed; every end of a run leaves it dark",
                          {{"set_level",
                            {{.name = "level", .type = Type::number, .min = 0, .max = 1}},
                            "",
                            "sets its light, as a part of the full current",
                            lamp_set,
                            "rig.lamp:set_level(0.4)"},
                           {"level", {}, "number", "as last set", lamp_level, "rig.lamp:level()"}}};
  return kind;
}

}  // namespace vitreo::lua
