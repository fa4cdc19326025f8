// Stages, rotation stages and field probes, for scripts.
// SPDX-License-Identifier: Apache-2.0
#include "devices/roles/field_probe.h"
#include "devices/roles/rotation_stage.h"
#include "devices/roles/stage.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/scheduler.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/rig/bind_rig.h"
#include "host/lua/rig/classes.h"
#include "host/text/units.h"

#include <algorithm>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

namespace vitreo::lua {
namespace {

constexpr double kLongestMove = 3600;  // s

Argument timeout(const char* usual) {
  return {.name = "timeout",
          .type = Type::number,
          .unit = "s",
          .optional = true,
          .min = 0,
          .max = kLongestMove,
          .help = std::string("how long it may take (") + usual + ")"};
}
Argument speed(const char* unit) {
  return {.name = "speed",
          .type = Type::number,
          .unit = unit,
          .optional = true,
          .min = 0,
          .help = "of the axis with the longest way (the rig's)"};
}
Time timeout_of(const Call& call, double usual) {
  return from_seconds(call.number_option("timeout").value_or(usual));
}

void push_numbers(lua_State* L, const std::vector<double>& numbers) {
  lua_createtable(L, static_cast<int>(numbers.size()), 0);
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    lua_pushnumber(L, numbers[i]);
    lua_rawseti(L, -2, static_cast<lua_Integer>(i) + 1);
  }
}
void set_text(lua_State* L, const char* name, const std::string& text) {
  lua_pushstring(L, text.c_str());
  lua_setfield(L, -2, name);
}
void set_identity(lua_State* L, const Identity& identity) {
  set_text(L, "identity", to_string(identity));
  set_text(L, "name", identity.name);
  set_text(L, "serial", identity.serial);
  set_text(L, "firmware", identity.firmware);
}
void set_axis(lua_State* L, const StageAxis& axis) {
  set_number(L, "travel_min", axis.travel_min);
  set_number(L, "travel_max", axis.travel_max);
  set_number(L, "max_speed", axis.max_speed);
  set_number(L, "speed", axis.speed);
  set_number(L, "resolution", axis.resolution);
}

double usual_speed(const std::vector<StageAxis>& axes) {
  double slowest = std::numeric_limits<double>::infinity();
  for (const StageAxis& axis : axes) slowest = std::min(slowest, axis.speed);
  return slowest;
}

/// Runs `talk` as a task and gives its result to `push`.
template <class Result, class Talk, class Push>
int talk_and_push(const Call& call, const char* name, Talk talk, const Push& push) {
  auto result = std::make_shared<Result>();
  return call.wait(work(
      call, name, [result, talk] { *result = talk(); }, from_seconds(kTalk),
      [result, push](Call& done) {
        push(done.L, *result);
        return 1;
      }));
}
template <class Work>
int run_and_return(const Call& call, const char* name, Work job, Time limit, WaitInfo about = {}) {
  return call.wait(work(
      call, name, std::move(job), limit, [](Call&) { return 0; }, std::move(about)));
}
std::string places_text(const std::vector<double>& places, const char* unit) {
  std::string text;
  for (const double place : places)
    text += (text.empty() ? "" : ", ") + format_quantity(place, unit);
  return text;
}
WaitInfo about(Stage* stage, const std::string& target) {
  return {target, [stage] { return places_text(stage->position(), "m"); }};
}
WaitInfo about(RotationStage* stage, const std::string& target) {
  return {target, [stage] { return format_quantity(stage->angle(), "rad"); }};
}
/// A device stops itself at its own deadline; ours is only there should it hang.
Time beyond(Time timeout) { return 2 * timeout + from_seconds(kTalk); }

const auto push_flag = [](lua_State* L, bool flag) { lua_pushboolean(L, flag ? 1 : 0); };
const auto push_number = [](lua_State* L, double number) { lua_pushnumber(L, number); };

// What stages of either kind do alike.
template <class AnyStage>
int any_moving(Call& call) {
  AnyStage* const stage = &call.self<AnyStage>();
  return talk_and_push<bool>(
      call, "stage", [stage] { return stage->moving(); }, push_flag);
}
template <class AnyStage>
int any_wait(Call& call) {
  AnyStage* const stage = &call.self<AnyStage>();
  const Time limit = timeout_of(call, 60);
  return run_and_return(
      call, "stage", [=] { stage->wait(limit); }, beyond(limit), about(stage, "its end"));
}
template <class AnyStage>
int any_home(Call& call) {
  AnyStage* const stage = &call.self<AnyStage>();
  Clock* const clock = &session_of(call.L).clock;
  const Time limit = timeout_of(call, 120);
  const auto go = [=] {
    try {
      stage->home(limit);
    } catch (...) {
      const StopShield shield(*clock);
      stage->stop();
      throw;
    }
  };
  return run_and_return(call, "stage", go, beyond(limit), about(stage, "its reference"));
}
template <class AnyStage>
int any_stop(Call& call) {
  AnyStage* const stage = &call.self<AnyStage>();
  return run_and_return(
      call, "stage", [=] { stage->stop(); }, from_seconds(kTalk));
}

int stage_info(Call& call) {
  const StageInfo& info = call.self<Stage>().info();
  lua_createtable(call.L, 0, 5);
  set_identity(call.L, info.identity);
  lua_createtable(call.L, static_cast<int>(info.axes.size()), 0);
  for (std::size_t i = 0; i < info.axes.size(); ++i) {
    lua_createtable(call.L, 0, 6);
    set_text(call.L, "name", info.axes[i].name);
    set_axis(call.L, info.axes[i]);
    lua_rawseti(call.L, -2, static_cast<lua_Integer>(i) + 1);
  }
  lua_setfield(call.L, -2, "axes");
  return 1;
}
int stage_position(Call& call) {
  Stage* const stage = &call.self<Stage>();
  return talk_and_push<std::vector<double>>(
      call, "stage", [stage] { return stage->position(); }, push_numbers);
}
double stage_speed(const Call& call) {
  return call.number_option("speed").value_or(usual_speed(call.self<Stage>().info().axes));
}
int stage_move(Call& call) {
  Stage* const stage = &call.self<Stage>();
  Clock* const clock = &session_of(call.L).clock;
  const Time limit = timeout_of(call, 60);
  const double speed = stage_speed(call);
  const auto go = [=, target = call.numbers(0)] { move_to(*stage, target, speed, limit, *clock); };
  return run_and_return(call, "stage", go, beyond(limit),
                        about(stage, places_text(call.numbers(0), "m")));
}
int stage_start(Call& call) {
  Stage* const stage = &call.self<Stage>();
  const double speed = stage_speed(call);
  const auto go = [=, target = call.numbers(0)] { stage->start(target, speed); };
  return run_and_return(call, "stage", go, from_seconds(kTalk));
}

int rotation_info(Call& call) {
  const RotationStageInfo& info = call.self<RotationStage>().info();
  lua_createtable(call.L, 0, 9);
  set_identity(call.L, info.identity);
  set_axis(call.L, info.axis);
  return 1;
}
int rotation_angle(Call& call) {
  RotationStage* const stage = &call.self<RotationStage>();
  return talk_and_push<double>(
      call, "rotation_stage", [stage] { return stage->angle(); }, push_number);
}
double rotation_speed(const Call& call) {
  return call.number_option("speed").value_or(call.self<RotationStage>().info().axis.speed);
}
int rotation_turn(Call& call) {
  RotationStage* const stage = &call.self<RotationStage>();
  Clock* const clock = &session_of(call.L).clock;
  const Time limit = timeout_of(call, 60);
  const double speed = rotation_speed(call);
  const auto go = [=, angle = call.number(0)] { turn_to(*stage, angle, speed, limit, *clock); };
  return run_and_return(call, "rotation_stage", go, beyond(limit),
                        about(stage, format_quantity(call.number(0), "rad")));
}
int rotation_start(Call& call) {
  RotationStage* const stage = &call.self<RotationStage>();
  const double speed = rotation_speed(call);
  const auto go = [=, angle = call.number(0)] { stage->start(angle, speed); };
  return run_and_return(call, "rotation_stage", go, from_seconds(kTalk));
}

int probe_info(Call& call) {
  const FieldProbeInfo& info = call.self<FieldProbe>().info();
  lua_createtable(call.L, 0, 6);
  set_identity(call.L, info.identity);
  set_number(call.L, "axes", info.axes);
  set_number(call.L, "range", info.range);
  return 1;
}
int probe_measure(Call& call) {
  FieldProbe* const probe = &call.self<FieldProbe>();
  const Time limit = timeout_of(call, 5);
  auto reading = std::make_shared<FieldReading>();
  return call.wait(work(
      call, "field probe", [=] { *reading = probe->measure(limit); }, beyond(limit),
      [reading](Call& done) {
        push_numbers(done.L, reading->field);
        set_number(done.L, "time", to_seconds(reading->measured));
        return 1;
      }));
}

template <class AnyStage>
std::vector<Binding> with_common(std::vector<Binding> rows) {
  rows.push_back({"moving",
                  {},
                  "boolean",
                  "whether the motion that was started goes on",
                  any_moving<AnyStage>});
  rows.push_back({"wait",
                  {options_of({timeout("60 s")})},
                  "",
                  "waits until the motion has ended; an error when it did not end at its target",
                  any_wait<AnyStage>});
  rows.push_back({"home",
                  {options_of({timeout("120 s")})},
                  "",
                  "moves until it has found the reference of its positions",
                  any_home<AnyStage>});
  rows.push_back({"stop", {}, "", "stops, and waits until it stands", any_stop<AnyStage>});
  return rows;
}

}  // namespace

const Class& stage_class() {
  const auto target = [] { return Argument{.name = "target", .type = Type::numbers, .unit = "m"}; };
  static const Class kind{
      "stage", "a stage of one or more linear axes",
      with_common<Stage>({{"info",
                           {},
                           "table",
                           "identity, name, serial, firmware, axes: name, travel_min in m, "
                           "travel_max in m, speed in m/s, max_speed "
                           "in m/s, "
                           "resolution in m",
                           stage_info},
                          {"position",
                           {},
                           "list of numbers in m",
                           "one per axis, from the stage's own origin",
                           stage_position},
                          {"move_to",
                           {target(), options_of({speed("m/s"), timeout("60 s")})},
                           "",
                           "moves all axes, and waits until they are there",
                           stage_move},
                          {"start",
                           {target(), options_of({speed("m/s")})},
                           "",
                           "sets off, and does not wait",
                           stage_start}})};
  return kind;
}

const Class& rotation_stage_class() {
  const auto angle = [] { return Argument{.name = "angle", .type = Type::number, .unit = "rad"}; };
  static const Class kind{
      "rotation_stage", "a stage that turns",
      with_common<RotationStage>(
          {{"info",
            {},
            "table",
            "identity, name, serial, firmware, travel_min in rad, travel_max in rad, ...",
            rotation_info},
           {"angle", {}, "number in rad", "from the stage's own origin", rotation_angle},
           {"turn_to",
            {angle(), options_of({speed("rad/s"), timeout("60 s")})},
            "",
            "turns, and waits until it is there",
            rotation_turn},
           {"start",
            {angle(), options_of({speed("rad/s")})},
            "",
            "sets off, and does not wait",
            rotation_start}})};
  return kind;
}

const Class& field_probe_class() {
  static const Class kind{
      "field_probe",
      "a teslameter",
      {{"info", {}, "table", "identity, name, serial, firmware, axes, range in T", probe_info},
       {"measure",
        {options_of({timeout("5 s")})},
        "list of numbers in T",
        "one per axis; its field time says when it was asked",
        probe_measure}}};
  return kind;
}

}  // namespace vitreo::lua
