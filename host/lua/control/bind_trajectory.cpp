// control.line, control.spiral ...: trajectories with speed and acceleration limited, for
// servo:follow.
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

int push_trajectory(const Call& call, Trajectory trajectory) {
  push_handle(call.L, trajectory_class(), std::make_shared<Trajectory>(std::move(trajectory)));
  return 1;
}

int point(Call& call) { return push_trajectory(call, Trajectory::hold_at(call.vector(0))); }
int line(Call& call) {
  return push_trajectory(call,
                         Trajectory::line(call.vector(0), call.vector(1), motion_limits(call)));
}
int rectangle(Call& call) {
  return push_trajectory(call, Trajectory::rectangle(call.vector(0), call.vector(1), call.vector(2),
                                                     motion_limits(call)));
}
int circle(Call& call) {
  return push_trajectory(
      call, Trajectory::circle(call.vector(0), call.vector(1), call.vector(2),
                               call.number_option("turns").value_or(1), motion_limits(call)));
}
int waypoints(Call& call) {
  return push_trajectory(
      call, Trajectory::waypoints(points_at(call.L, call.index(0), "points"), motion_limits(call)));
}
int spline(Call& call) {
  return push_trajectory(
      call, Trajectory::spline(points_at(call.L, call.index(0), "points"), motion_limits(call)));
}

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

int duration(Call& call) { return call.result(call.self<Trajectory>().duration()); }
int length(Call& call) { return call.result(call.self<Trajectory>().length()); }
int at(Call& call) {
  const control::Reference reference = call.self<Trajectory>().at(call.number(0));
  push_vector(call.L, reference.position);
  push_vector(call.L, reference.velocity);
  return 2;
}

}  // namespace

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
  const auto number = [](const char* name, const char* unit, double min, double max,
                         const char* help) {
    return Argument{.name = name,
                    .type = Type::number,
                    .unit = unit,
                    .optional = true,
                    .min = min,
                    .max = max,
                    .help = help};
  };
  return {number("speed", "m/s", 1e-6, 10e-3, "along the way (0.5 mm/s)"),
          number("acceleration", "m/s^2", 1e-5, 1, "along and across the way (2 mm/s^2)")};
}

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
  const Argument points{
      .name = "points", .type = Type::list, .unit = "m", .help = "positions {x, y, z}"};
  return {{"control.point", {place("position")}, "trajectory", "stays at a place", point},
          {"control.line",
           {place("from"), place("to"), options_of({}, motion_options())},
           "trajectory",
           "a straight line",
           line},
          {"control.rectangle",
           {place("corner"), place("side", "from the corner to the next"),
            place("up", "and on to the one after"), options_of({}, motion_options())},
           "trajectory",
           "round a rectangle, at rest in its corners",
           rectangle},
          {"control.circle",
           {place("center"), place("first", "from the center to where it begins"),
            place("second", "towards where it goes: as long, at a right angle"),
            options_of({number("turns", "", "(1)")}, motion_options())},
           "trajectory",
           "round a circle",
           circle},
          {"control.spiral",
           {options_of({{.name = "bottom",
                         .type = Type::vector,
                         .unit = "m",
                         .optional = true,
                         .help = "lower end of its axis, which is the world's z ({0, 0, -3 mm})"},
                        number("height", "m", "(6 mm)"),
                        number("first_radius", "m", "at the bottom (0.5 mm)"),
                        number("last_radius", "m", "at the top (3.5 mm)"),
                        number("turns", "", "(4)")},
                       motion_options())},
           "trajectory",
           "a spiral that widens as it climbs, like those of thesis 5.5",
           spiral},
          {"control.waypoints",
           {points, options_of({}, motion_options())},
           "trajectory",
           "straight lines, at rest at each point",
           waypoints},
          {"control.spline",
           {points, options_of({}, motion_options())},
           "trajectory",
           "a smooth curve through points, without rest",
           spline}};
}

const Class& trajectory_class() {
  static const Class kind{
      "trajectory",
      "places as a function of time; make one with control.line and its like, go along it with "
      "servo:follow",
      {{"duration", {}, "number in s", "how long it takes", duration},
       {"length", {}, "number in m", "how long the way is", length},
       {"at",
        {{.name = "time", .type = Type::number, .unit = "s", .help = "since it began"}},
        "position in m, velocity in m/s",
        "where it is then; before its begin and after its end at rest",
        at}}};
  return kind;
}

}  // namespace vitreo::lua
