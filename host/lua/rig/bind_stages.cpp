// Bindings of stages, rotation stages and field probes.
// SPDX-License-Identifier: Apache-2.0
#include "devices/roles/field_probe.h"
#include "devices/roles/rotation_stage.h"
#include "devices/roles/stage.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/scheduler.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/interpreter/work.h"
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

void set_identity(ResultTable& table, const Identity& identity) {
  table.text("identity", to_string(identity))
      .text("name", identity.name)
      .text("serial", identity.serial)
      .text("firmware", identity.firmware);
}
/// `unit`: m of a linear axis, rad of one that turns.
void set_axis(ResultTable& table, const StageAxis& axis, const std::string& unit) {
  const std::string speed = unit + "/s";
  table.number("travel_min", axis.travel_min, unit.c_str())
      .number("travel_max", axis.travel_max, unit.c_str())
      .number("max_speed", axis.max_speed, speed.c_str())
      .number("speed", axis.speed, speed.c_str())
      .number("resolution", axis.resolution, unit.c_str());
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
      [result, push](Call& done) { return push(done, *result); }));
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

const auto push_flag = [](const Call& call, bool flag) { return call.flag(flag); };

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
  ResultTable table(call);
  set_identity(table, info.identity);
  table.list("axes", info.axes.size(), [&info](ResultTable& axis, std::size_t i) {
    axis.text("name", info.axes[i].name);
    set_axis(axis, info.axes[i], "m");
  });
  return 1;
}
int stage_position(Call& call) {
  Stage* const stage = &call.self<Stage>();
  return talk_and_push<std::vector<double>>(
      call, "stage", [stage] { return stage->position(); },
      [](const Call& done, const std::vector<double>& at) { return done.result(at, "m"); });
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
  ResultTable table(call);
  set_identity(table, info.identity);
  set_axis(table, info.axis, "rad");
  return 1;
}
int rotation_angle(Call& call) {
  RotationStage* const stage = &call.self<RotationStage>();
  return talk_and_push<double>(
      call, "rotation_stage", [stage] { return stage->angle(); },
      [](const Call& done, double angle) { return done.result(angle, "rad"); });
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
  ResultTable table(call);
  set_identity(table, info.identity);
  table.number("axes", info.axes).number("range", info.range, "T");
  return 1;
}
int probe_measure(Call& call) {
  FieldProbe* const probe = &call.self<FieldProbe>();
  const Time limit = timeout_of(call, 5);
  auto reading = std::make_shared<FieldReading>();
  return call.wait(work(
      call, "field probe", [=] { *reading = probe->measure(limit); }, beyond(limit),
      [reading](Call& done) {
        const int count = done.result(reading->field, "T");
        set_number(done.L, "time", to_seconds(reading->measured));
        return count;
      }));
}

std::vector<ResultField> identity_fields(std::vector<ResultField> more) {
  std::vector<ResultField> fields = {
      {"identity", "", "all of it"}, {"name", "", ""}, {"serial", "", ""}, {"firmware", "", ""}};
  for (ResultField& one : more) fields.push_back(std::move(one));
  return fields;
}

std::vector<ResultField> axis_fields(const std::string& unit) {
  const std::string speed = unit + "/s";
  return {{"travel_min", unit, ""},
          {"travel_max", unit, ""},
          {"max_speed", speed, ""},
          {"speed", speed, "where none is given"},
          {"resolution", unit, ""}};
}

template <class AnyStage>
std::vector<Binding> with_common(const std::string& handle, std::vector<Binding> rows) {
  rows.push_back({"moving",
                  {},
                  "true or false",
                  "whether the motion that was started goes on",
                  any_moving<AnyStage>,
                  handle + ":moving()"});
  rows.push_back({"wait",
                  {options_of({timeout("60 s")})},
                  "",
                  "waits until the motion has ended; an error when it did not end at its target",
                  any_wait<AnyStage>,
                  handle + ":wait()"});
  rows.push_back({"home",
                  {options_of({timeout("120 s")})},
                  "",
                  "moves until it has found the reference of its positions",
                  any_home<AnyStage>,
                  handle + ":home()"});
  rows.push_back(
      {"stop", {}, "", "stops, and waits until it stands", any_stop<AnyStage>, handle + ":stop()"});
  return rows;
}

}  // namespace

const Class& stage_class() {
  const auto target = [] { return Argument{.name = "target", .type = Type::numbers, .unit = "m"}; };
  std::vector<ResultField> axis = axis_fields("m");
  axis.insert(axis.begin(), {"name", "", ""});
  static const Class kind{
      "stage", "a stage of one or more linear axes",
      with_common<Stage>("rig.stage", {{"info",
                                        {},
                                        {"table", identity_fields({{"axes", "", "a list", axis}})},
                                        "what stage it is",
                                        stage_info,
                                        "rig.stage:info()"},
                                       {"position",
                                        {},
                                        {"list of numbers", "m"},
                                        "one per axis, from the stage's own origin",
                                        stage_position,
                                        "rig.stage:position()"},
                                       {"move_to",
                                        {target(), options_of({speed("m/s"), timeout("60 s")})},
                                        "",
                                        "moves all axes, and waits until they are there",
                                        stage_move,
                                        "rig.stage:move_to({ 0.1 * mm })"},
                                       {"start",
                                        {target(), options_of({speed("m/s")})},
                                        "",
                                        "sets off, and does not wait",
                                        stage_start,
                                        "rig.stage:start({ 0.2 * mm })"}})};
  return kind;
}

const Class& rotation_stage_class() {
  const auto angle = [] { return Argument{.name = "angle", .type = Type::number, .unit = "rad"}; };
  Argument turning = speed("rad/s");
  turning.help = "(the rig's)";
  static const Class kind{
      "rotation_stage", "a stage that turns",
      with_common<RotationStage>("rig.rotation_stage",
                                 {{"info",
                                   {},
                                   {"table", identity_fields(axis_fields("rad"))},
                                   "what stage it is",
                                   rotation_info,
                                   "rig.rotation_stage:info()"},
                                  {"angle",
                                   {},
                                   {"number", "rad"},
                                   "from the stage's own origin",
                                   rotation_angle,
                                   "rig.rotation_stage:angle()"},
                                  {"turn_to",
                                   {angle(), options_of({turning, timeout("60 s")})},
                                   "",
                                   "turns, and waits until it is there",
                                   rotation_turn,
                                   "rig.rotation_stage:turn_to(5 * deg)"},
                                  {"start",
                                   {angle(), options_of({turning})},
                                   "",
                                   "sets off, and does not wait",
                                   rotation_start,
                                   "rig.rotation_stage:start(10 * deg)"}})};
  return kind;
}

const Class& field_probe_class() {
  static const Class kind{
      "field_probe",
      "a teslameter",
      {{"info",
        {},
        {"table", identity_fields({{"axes", "", "how many"}, {"range", "T", ""}})},
        "what teslameter it is",
        probe_info,
        "rig.field_probe:info()"},
       {"measure",
        {options_of({timeout("5 s")})},
        {"list of numbers", "T"},
        "one per axis; its field time, in s, says when it was asked",
        probe_measure,
        "rig.field_probe:measure()"}}};
  return kind;
}

}  // namespace vitreo::lua
