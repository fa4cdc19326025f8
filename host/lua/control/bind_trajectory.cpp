// Bindings of trajectories (control.line, control.spiral, ...), limited in speed and acceleration.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/control/bind_control.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/interpreter/values.h"

#include <stdexcept>
#include <string>
#include <utility>

namespace vitreo::lua {
namespace {

using control::Trajectory;

/// A value: following it does not use it up.
int push_trajectory(const Call& call, Trajectory trajectory) {
  push_handle(call.L, trajectory_class(), std::make_shared<Trajectory>(std::move(trajectory)));
  return 1;
}

/// An option that the row requires, so that it is there.
Eigen::Vector3d needed(const Call& call, const char* name) { return *call.vector_option(name); }

/// World frame, m; at least one.
std::vector<Eigen::Vector3d> points_option(const Call& call) {
  call.push_option("points");
  std::vector<Eigen::Vector3d> points = points_at(call.L, lua_gettop(call.L), "points");
  lua_pop(call.L, 1);
  return points;
}

/// Shapes below start and end at rest, in the least time that speed and acceleration allow; what is
/// too short or not finite is refused by name (control::Trajectory).
int line(Call& call) {
  return push_trajectory(
      call, Trajectory::line(needed(call, "from"), needed(call, "to"), motion_limits(call)));
}
int rectangle(Call& call) {
  return push_trajectory(call, Trajectory::rectangle(needed(call, "corner"), needed(call, "side"),
                                                     needed(call, "up"), motion_limits(call)));
}
/// Two radii say center, plane, sense and where it begins; they must be as long and at a right
/// angle.
int circle(Call& call) {
  return push_trajectory(
      call,
      Trajectory::circle(needed(call, "center"), needed(call, "first"), needed(call, "second"),
                         call.number_option("turns").value_or(1), motion_limits(call)));
}
/// Corners are corners: it stops in each, since no acceleration could turn there at speed.
int waypoints(Call& call) {
  return push_trajectory(call, Trajectory::waypoints(points_option(call), motion_limits(call)));
}
int spline(Call& call) {
  return push_trajectory(call, Trajectory::spline(points_option(call), motion_limits(call)));
}

/// Absent numbers keep those of the spiral of thesis 5.5 (control::Spiral).
int spiral(Call& call) {
  control::Spiral shape;
  shape.bottom = call.vector_option("bottom").value_or(shape.bottom);
  const auto take = [&call](const char* name, double& value) {
    value = call.number_option(name).value_or(value);
  };
  take("height", shape.height);
  take("first_radius", shape.first_radius);
  take("last_radius", shape.last_radius);
  take("turns", shape.turns);
  return push_trajectory(call, Trajectory::spiral(shape, motion_limits(call)));
}

int info(Call& call) {
  const auto& path = call.self<Trajectory>();
  ResultTable(call).number("duration", path.duration(), "s").number("length", path.length(), "m");
  return 1;
}
/// Clamped: before its begin and after its end it stands, with velocity 0.
int at(Call& call) {
  const control::Reference reference = call.self<Trajectory>().at(call.number(0));
  ResultTable(call)
      .vector("position", reference.position, "m")
      .vector("velocity", reference.velocity, "m/s");
  return 1;
}

}  // namespace

/// Numbers of entries count from 1 in errors, as in the script.
std::vector<Eigen::Vector3d> points_at(lua_State* L, int index, const char* name) {
  std::vector<Eigen::Vector3d> points;
  const auto count = static_cast<lua_Integer>(lua_rawlen(L, index));
  for (lua_Integer i = 1; i <= count; ++i) {
    lua_rawgeti(L, index, i);
    const auto point = to_vector(L, -1);
    lua_pop(L, 1);
    if (!point)
      throw std::invalid_argument(std::string(name) + ": number " + std::to_string(i) +
                                  " is not a position {x, y, z}");
    points.push_back(*point);
  }
  if (points.empty()) throw std::invalid_argument(std::string(name) + ": the list is empty");
  return points;
}

std::vector<Argument> motion_options() {
  const auto number = number_option;
  return {number("speed", "m/s", 1e-6, 10e-3, "along the way (0.5 mm/s)"),
          number("acceleration", "m/s^2", 1e-5, 1, "along and across the way (2 mm/s^2)")};
}

/// Also for servo:follow, which makes a path of a list of positions by the same rules.
control::MotionLimits motion_limits(const Call& call) {
  control::MotionLimits limits;
  limits.speed = call.number_option("speed").value_or(limits.speed);
  limits.acceleration = call.number_option("acceleration").value_or(limits.acceleration);
  return limits;
}

std::vector<Binding> trajectory_functions() {
  const auto place = [](const char* name, const char* help = "") {
    return Argument{.name = name, .type = Type::vector, .unit = "m", .help = help};
  };
  const auto number = [](const char* name, const char* unit, const char* help) {
    return Argument{
        .name = name, .type = Type::number, .unit = unit, .optional = true, .help = help};
  };
  const auto moving = [](std::vector<Argument> keys) {
    return std::vector<Argument>{options_of(std::move(keys), motion_options())};
  };
  const Argument points{
      .name = "points", .type = Type::list, .unit = "m", .help = "positions {x, y, z}"};
  Argument bottom =
      place("bottom", "lower end of its axis, which is the world's z ({0, 0, -3 mm})");
  bottom.optional = true;
  return {
      {"control.line", moving({place("from"), place("to")}), "trajectory", "a straight line", line,
       "control.line { from = { 0, 0, 0 }, to = { 1 * mm, 0, 0 }, speed = 0.5 * mm / s }"},
      {"control.rectangle",
       moving({place("corner"), place("side", "from the corner to the next"),
               place("up", "and on to the one after")}),
       "trajectory", "round a rectangle, at rest in its corners", rectangle,
       "control.rectangle { corner = { 0, 0, 0 }, side = { 2 * mm, 0, 0 }, up = { 0, 0, mm } }"},
      {"control.circle",
       moving({place("center"), place("first", "from the center to where it begins"),
               place("second", "towards where it goes: as long, at a right angle"),
               number("turns", "", "(1)")}),
       "trajectory", "round a circle", circle,
       "control.circle { center = { 0, 0, 0 }, first = { mm, 0, 0 }, second = { 0, mm, 0 } }"},
      {"control.spiral",
       moving({bottom, number("height", "m", "(6 mm)"),
               number("first_radius", "m", "at the bottom (0.5 mm)"),
               number("last_radius", "m", "at the top (3.5 mm)"), number("turns", "", "(4)")}),
       "trajectory", "a spiral that widens as it climbs, like those of thesis 5.5", spiral,
       "control.spiral { height = 4 * mm, turns = 3 }"},
      {"control.waypoints", moving({points}), "trajectory", "straight lines, at rest at each point",
       waypoints, "control.waypoints { points = { { 0, 0, 0 }, { mm, 0, 0 }, { mm, mm, 0 } } }"},
      {"control.spline", moving({points}), "trajectory",
       "a smooth curve through points, without rest", spline,
       "control.spline { points = { { 0, 0, 0 }, { mm, 0, 0 }, { mm, mm, 0 } } }"}};
}

const Class& trajectory_class() {
  static const Class kind{
      "trajectory",
      "positions as a function of time; make one with control.line and its like, go along it with "
      "servo:follow",
      {{"info",
        {},
        {"table", {{"duration", "s", "from its begin to its end"}, {"length", "m", "of the way"}}},
        "how long it takes, and how long the way is",
        info,
        "path:info()"},
       {"at",
        {{.name = "time", .type = Type::number, .unit = "s", .help = "since it began"}},
        {"table", {{"position", "m", "where it is then"}, {"velocity", "m/s", "how fast"}}},
        "position and velocity then; before its begin and after its end at rest",
        at,
        "path:at(0.5 * s)"}}};
  return kind;
}

}  // namespace vitreo::lua
