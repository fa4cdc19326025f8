// Bindings of stages and rotation stages: the same calls, in m of each axis or in rad of one.
// SPDX-License-Identifier: Apache-2.0
#include "devices/roles/rotation_stage.h"
#include "devices/roles/stage.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/scheduler.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/interpreter/work.h"
#include "host/lua/rig/bind_rig.h"
#include "host/lua/rig/classes.h"
#include "host/lua/rig/motion.h"
#include "host/text/columns.h"

#include <algorithm>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

namespace vitreo::lua {
namespace {

constexpr double kLongestMove = 3600;                // s
constexpr double kUsualMove = 60, kUsualHome = 120;  // s

/// The option `timeout` of a call that waits, with the number that stands for it where it is left
/// out.
Argument motion_timeout(const char* usual) {
  return {.name = "timeout",
          .type = Type::number,
          .unit = "s",
          .optional = true,
          .min = 0,
          .max = kLongestMove,
          .help = std::string("how long it may take (") + usual + "); then it is stopped"};
}
Time timeout_of(const Call& call, double usual) {
  return from_seconds(call.number_option("timeout").value_or(usual));
}

// What differs between the two roles: the type and the unit of a position, and the usual speed.

template <class AnyStage>
struct Kind;

template <>
struct Kind<Stage> {
  using Position = std::vector<double>;
  static constexpr const char* name = "stage";
  static constexpr const char* unit = "m";
  static Position target(const Call& call) { return call.numbers(0); }
  static std::string text(const Position& position) {
    const ShownColumn column = show_column(position, unit);
    std::string text;
    for (const std::string& number : column.numbers) text += (text.empty() ? "" : ", ") + number;
    return with_unit({text, column.unit});
  }
  /// That of the slowest axis, since the speed given to start() is of the axis with the longest
  /// way, whichever that is.
  static double speed(const StageInfo& info) {
    double slowest = std::numeric_limits<double>::infinity();
    for (const StageAxis& axis : info.axes) slowest = std::min(slowest, axis.speed);
    return slowest;
  }
};

template <>
struct Kind<RotationStage> {
  using Position = double;
  static constexpr const char* name = "rotation_stage";
  static constexpr const char* unit = "rad";
  static Position target(const Call& call) { return call.number(0); }
  static std::string text(Position position) { return format_quantity(position, unit); }
  static double speed(const RotationStageInfo& info) { return info.axis.speed; }
};

template <class AnyStage>
double speed_of(const Call& call) {
  return call.number_option("speed").value_or(Kind<AnyStage>::speed(call.self<AnyStage>().info()));
}

/// What an error of a wait that took too long says beside the device's own words.
template <class AnyStage>
WaitInfo about(AnyStage* stage, const std::string& target) {
  return {target, [stage] { return Kind<AnyStage>::text(stage->position()); }};
}

/// Kept by the state and not by the handle of the stage: several handles may be of one stage, at
/// the prompt for one.
std::shared_ptr<StageMotions> motions_of(const Call& call) {
  std::shared_ptr<StageMotions>& motions = call.context().motions[call.self_pointer().get()];
  if (!motions) motions = std::make_shared<StageMotions>();
  return motions;
}

// Some instruments may not be asked while they move; their driver then gives an estimate.
template <class AnyStage>
int any_position(Call& call) {
  using Position = typename Kind<AnyStage>::Position;
  AnyStage* const stage = &call.self<AnyStage>();
  auto position = std::make_shared<Position>();
  return call.wait(work(
      call, Kind<AnyStage>::name, [=] { *position = stage->position(); }, from_seconds(kTalk),
      [position](Call& done) { return done.result(*position, Kind<AnyStage>::unit); }));
}

// Whatever ends the wait early also stops the stage: see move_to() of the roles.
template <class AnyStage>
int any_move(Call& call) {
  AnyStage* const stage = &call.self<AnyStage>();
  Clock* const clock = &session_of(call.L).clock;
  const Time limit = timeout_of(call, kUsualMove);
  const auto target = Kind<AnyStage>::target(call);
  const auto go = [=, speed = speed_of<AnyStage>(call), motions = motions_of(call)] {
    keep_ending(*motions);
    move_to(*stage, target, speed, limit, *clock);
  };
  return call.wait(work(
      call, Kind<AnyStage>::name, go, hang_limit(limit), [](Call&) { return 0; },
      about(stage, Kind<AnyStage>::text(target))));
}

// The handle is made only when the stage has set off: a target that is refused is an error of
// start, and the handle of the motion before stays the last one.
template <class AnyStage>
int any_start(Call& call) {
  AnyStage* const stage = &call.self<AnyStage>();
  const auto target = Kind<AnyStage>::target(call);
  auto motion = std::make_shared<Motion>();
  motion->device = Kind<AnyStage>::name;
  motion->target = Kind<AnyStage>::text(target);
  motion->moving = [stage] { return stage->moving(); };
  motion->wait = [stage](Time timeout) { stage->wait(timeout); };
  motion->reading = about(stage, "").reading;
  const auto go = [=, speed = speed_of<AnyStage>(call), motions = motions_of(call)] {
    keep_ending(*motions);
    stage->start(target, speed);
    motions->last = motion;
  };
  return call.wait(work(call, Kind<AnyStage>::name, go, from_seconds(kTalk), [motion](Call& done) {
    push_handle(done.L, motion_class(), motion);
    return 1;
  }));
}

// A stage on the way to its reference has no target that would end it, so a wait that is broken off
// stops it, and the stop itself cannot be broken off.
template <class AnyStage>
int any_home(Call& call) {
  AnyStage* const stage = &call.self<AnyStage>();
  Clock* const clock = &session_of(call.L).clock;
  const Time limit = timeout_of(call, kUsualHome);
  const auto go = [=, motions = motions_of(call)] {
    keep_ending(*motions);
    try {
      stage->home(limit);
    } catch (...) {
      const StopShield shield(*clock);
      stage->stop();
      throw;
    }
  };
  return call.wait(work(
      call, Kind<AnyStage>::name, go, hang_limit(limit), [](Call&) { return 0; },
      about(stage, "its reference")));
}

// Also of a motion that no script has begun, at the instrument's own panel.
template <class AnyStage>
int any_stop(Call& call) {
  AnyStage* const stage = &call.self<AnyStage>();
  return call.wait(work(
      call, Kind<AnyStage>::name, [=] { stage->stop(); }, from_seconds(kTalk),
      [](Call&) { return 0; }));
}

/// An axis without ends has no travel: its fields stay nil, for they are not finite.
void set_axis(ResultTable& table, const StageAxis& axis, const std::string& unit) {
  const std::string speed = unit + "/s";
  table.number("travel_min", axis.travel_min, unit.c_str())
      .number("travel_max", axis.travel_max, unit.c_str())
      .number("max_speed", axis.max_speed, speed.c_str())
      .number("speed", axis.speed, speed.c_str())
      .number("resolution", axis.resolution, unit.c_str());
}

std::vector<ResultField> axis_fields(const std::string& unit) {
  const std::string speed = unit + "/s";
  return {{.name = "travel_min", .unit = unit, .help = "nil without an end", .optional = true},
          {.name = "travel_max", .unit = unit, .help = "nil without an end", .optional = true},
          {"max_speed", speed, ""},
          {"speed", speed, "where none is given"},
          {"resolution", unit, ""}};
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

int rotation_info(Call& call) {
  const RotationStageInfo& info = call.self<RotationStage>().info();
  ResultTable table(call);
  set_identity(table, info.identity);
  set_axis(table, info.axis, "rad");
  return 1;
}

/// The rows of what both kinds do, behind that of info(). `handle`: "rig.stage"; `place` and
/// `other` are two targets of the examples.
template <class AnyStage>
std::vector<Binding> moving_rows(const std::string& handle, const std::string& place,
                                 const std::string& other, const Argument& target,
                                 const Argument& speed) {
  const bool numbers = target.type == Type::numbers;
  const Returned position(numbers ? "list of numbers" : "number", Kind<AnyStage>::unit);
  return {{"position",
           {},
           position,
           numbers ? "one per axis, from the stage's own origin" : "from the stage's own origin",
           any_position<AnyStage>,
           handle + ":position()"},
          {"move_to",
           {target, options_of({speed, motion_timeout("60 s")})},
           "",
           "moves, and waits until it is there",
           any_move<AnyStage>,
           handle + ":move_to(" + place + ")"},
          {"start",
           {target, options_of({speed})},
           "motion",
           "sets off, and does not wait; an error while it still moves",
           any_start<AnyStage>,
           handle + ":start(" + other + ")"},
          {"stop",
           {},
           "",
           "stops, and waits until it stands; a motion that was under way ends in an error",
           any_stop<AnyStage>,
           handle + ":stop()"},
          {"home",
           {options_of({motion_timeout("120 s")})},
           "",
           "moves until it has found the reference of its positions",
           any_home<AnyStage>,
           handle + ":home()"}};
}

/// info() stands first on the page.
Class with_info(Class made, Binding info) {
  made.methods.insert(made.methods.begin(), std::move(info));
  return made;
}

Argument speed_option(const char* unit, const char* help) {
  return {.name = "speed",
          .type = Type::number,
          .unit = unit,
          .optional = true,
          .min = 0,
          .help = help};
}

}  // namespace

const Class& stage_class() {
  std::vector<ResultField> axis = axis_fields("m");
  axis.insert(axis.begin(), {"name", "", ""});
  static const Class kind = with_info(
      {"stage", "a stage of one or more linear axes",
       moving_rows<Stage>(
           "rig.stage", "{ 0.1 * mm }", "{ 0.2 * mm }",
           {.name = "target", .type = Type::numbers, .unit = "m", .help = "one number an axis"},
           speed_option("m/s", "of the axis with the longest way (the rig's)"))},
      {"info",
       {},
       {"table", identity_fields({{"axes", "", "a list", axis}})},
       "what stage it is",
       stage_info,
       "rig.stage:info()"});
  return kind;
}

const Class& rotation_stage_class() {
  static const Class kind =
      with_info({"rotation_stage", "a stage that turns",
                 moving_rows<RotationStage>("rig.rotation_stage", "5 * deg", "10 * deg",
                                            {.name = "target", .type = Type::number, .unit = "rad"},
                                            speed_option("rad/s", "(the rig's)"))},
                {"info",
                 {},
                 {"table", identity_fields(axis_fields("rad"))},
                 "what stage it is",
                 rotation_info,
                 "rig.rotation_stage:info()"});
  return kind;
}

}  // namespace vitreo::lua
