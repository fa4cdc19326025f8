// What the operator holds or stands on, and the lamp, for scripts.
// SPDX-License-Identifier: Apache-2.0
#include "devices/roles/lamp.h"
#include "devices/roles/operator_input.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/scheduler.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/rig/bind_rig.h"
#include "host/lua/rig/classes.h"

#include <cstdint>
#include <memory>

namespace vitreo::lua {
namespace {

constexpr unsigned kButtons = 32;

void push_state(lua_State* L, const OperatorState& state) {
  lua_createtable(L, 0, 3);
  push_vector(L, state.translation);
  lua_setfield(L, -2, "translation");
  push_vector(L, state.rotation);
  lua_setfield(L, -2, "rotation");
  lua_createtable(L, 0, 0);
  for (unsigned button = 0; button < kButtons; ++button) {
    if ((state.pressed >> button & 1U) == 0) continue;
    lua_pushboolean(L, 1);
    lua_rawseti(L, -2, button + 1);
  }
  lua_setfield(L, -2, "pressed");
}

int input_state(Call& call) {
  OperatorInput* const input = &call.self<OperatorInput>();
  auto state = std::make_shared<OperatorState>();
  return call.wait(work(
      call, "operator", [=] { *state = input->state(); }, from_seconds(kTalk),
      [state](Call& done) {
        push_state(done.L, *state);
        return 1;
      }));
}

int input_held(Call& call) {
  OperatorInput* const input = &call.self<OperatorInput>();
  const auto mask = 1U << (static_cast<unsigned>(call.number(0)) - 1);
  auto held = std::make_shared<bool>(false);
  return call.wait(work(
      call, "operator", [=] { *held = is_held(input, mask); }, from_seconds(kTalk),
      [held](Call& done) {
        lua_pushboolean(done.L, *held ? 1 : 0);
        return 1;
      }));
}

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
        "table",
        "what the operator does now: translation and rotation, each {x, y, z} of full deflection; "
        "pressed[n] is true "
        "while button n is down. An input that was unplugged is an error, for ever",
        input_state},
       {"held",
        {{.name = "button", .type = Type::integer, .min = 1, .max = kButtons, .help = "from 1"}},
        "boolean",
        "whether button or pedal n is down; an input that is gone is a released one",
        input_held}}};
  return kind;
}

const Class& lamp_class() {
  static const Class kind{"lamp",
                          "a lamp that can be dimmed; every end of a run leaves it dark",
                          {{"set_level",
                            {{.name = "level", .type = Type::number, .min = 0, .max = 1}},
                            "",
                            "sets its light, as a part of the full current",
                            lamp_set},
                           {"level", {}, "number", "as last set", lamp_level}}};
  return kind;
}

}  // namespace vitreo::lua
