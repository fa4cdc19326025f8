// Bindings of robot identification: responses and falls from the record's streams.
// SPDX-License-Identifier: Apache-2.0
#include "control/robot_identification.h"
#include "host/lua/control/bind_control.h"
#include "host/lua/interpreter/calculation.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/interpreter/values.h"

#include <array>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace vitreo::lua {
namespace {

using control::TimedVector;

/// A table {time, x, y, z} of lists, as run:samples gives it; `names` are those of x, y, z. Rows
/// in which the robot was not seen are left out.
std::vector<TimedVector> rows_of(const OptionTable& table, const std::string& where,
                                 const std::array<const char*, 3>& names) {
  const auto times = table.numbers("time");
  std::vector<TimedVector> rows(times ? times->size() : 0);
  if (!times) throw std::invalid_argument(where + ": wants the lists time, x, y and z");
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto values = table.numbers(names[axis]);
    if (!values || values->size() != rows.size())
      throw std::invalid_argument(where + ": " + names[axis] + ": wants a number for each time");
    for (std::size_t i = 0; i < rows.size(); ++i) {
      rows[i].time = (*times)[i];
      rows[i].value[static_cast<Eigen::Index>(axis)] = (*values)[i];
    }
  }
  // The record has NaN where nothing was measured; a gap is no harm to least squares.
  std::erase_if(rows, [](const TimedVector& row) { return !row.value.allFinite(); });
  return rows;
}

std::vector<TimedVector> rows_option(const Call& call, const char* name,
                                     const std::array<const char*, 3>& names) {
  call.push_option(name);
  auto rows = rows_of(OptionTable(call.L, lua_gettop(call.L)), name, names);
  lua_pop(call.L, 1);
  return rows;
}

constexpr std::array<const char*, 3> kPosition{"x", "y", "z"};
constexpr std::array<const char*, 3> kCommanded{"commanded_x", "commanded_y", "commanded_z"};

/// Off the script's task (calculate): a fit solves the least squares some fifty times.
int identify_response(Call& call) {
  control::DrivenMotion motion;
  motion.measured = rows_option(call, "measured", kPosition);
  motion.commanded = rows_option(call, "commanded", kCommanded);
  motion.lag = call.number_option("lag").value_or(motion.lag);
  const Eigen::Vector3d direction = call.vector_option("direction")->normalized();
  // Before the calculation begins: what is wrong with the arguments is an error of the call.
  motion.check();
  return calculate(
      call, "identification",
      [motion = std::move(motion), direction](const YieldPoint&) {
        return control::identify_response(motion, direction);
      },
      [](const Call& done, const control::IdentifiedResponse& found) {
        ResultTable(done)
            .number("delay", found.delay.value, "s")
            .number("delay_sigma", found.delay.sigma, "s")
            .number("gain", found.gain.value)
            .number("gain_sigma", found.gain.sigma)
            .number("drift", found.drift.value, "m/s")
            .number("drift_sigma", found.drift.sigma, "m/s")
            .number("residual", found.residual, "m")
            .number("excitation", found.excitation, "m");
        return 1;
      });
}

/// The option `falls`, a list of {measured, off, on}.
std::vector<control::Fall> falls_option(const Call& call) {
  std::vector<control::Fall> falls;
  call.push_option("falls");
  const int list = lua_gettop(call.L);
  const auto count = static_cast<lua_Integer>(lua_rawlen(call.L, list));
  for (lua_Integer i = 1; i <= count; ++i) {
    const std::string where = "falls: " + std::to_string(i);
    if (lua_rawgeti(call.L, list, i) != LUA_TTABLE)
      throw std::invalid_argument(where + ": wants a table {measured, off, on}");
    const OptionTable entry(call.L, lua_gettop(call.L));
    const auto off = entry.number("off"), on = entry.number("on");
    if (!off || !on) throw std::invalid_argument(where + ": off, on: wants two times in s");
    control::Fall fall;
    fall.off = *off;
    fall.on = *on;
    lua_getfield(call.L, -1, "measured");
    if (!lua_istable(call.L, -1))
      throw std::invalid_argument(where + ": measured: wants a table of lists");
    fall.measured = rows_of(OptionTable(call.L, lua_gettop(call.L)), where, kPosition);
    lua_pop(call.L, 2);
    falls.push_back(std::move(fall));
  }
  lua_pop(call.L, 1);
  return falls;
}

int identify_fall(Call& call) {
  return calculate(
      call, "identification",
      [falls = falls_option(call),
       lag = call.number_option("lag").value_or(0.0106)](const YieldPoint&) {
        // World z is up: the speed of a robot that sinks is positive.
        return control::identify_fall(falls, Eigen::Vector3d(0, 0, -1), lag);
      },
      [](const Call& done, const control::IdentifiedFall& found) {
        ResultTable(done)
            .number("delay", found.delay.value, "s")
            .number("delay_sigma", found.delay.sigma, "s")
            .number("speed", found.speed.value, "m/s")
            .number("speed_sigma", found.speed.sigma, "m/s")
            .number("residual", found.residual, "m")
            .integer("samples", found.samples);
        return 1;
      });
}

}  // namespace

std::vector<Binding> identification_functions() {
  const auto number = number_option;
  const Argument measured{.name = "measured",
                          .type = Type::table,
                          .help = "lists time, x, y, z, as of run:samples(\"servo\", ...)"};
  const Argument commanded{
      .name = "commanded",
      .type = Type::table,
      .help = "lists time, commanded_x, commanded_y, commanded_z, as of the stream estimate"};
  const Argument direction{
      .name = "direction", .type = Type::direction, .help = "the coordinate that is taken"};
  const Argument falls{.name = "falls",
                       .type = Type::list,
                       .help =
                           "of {measured, off, on}: positions, and the times that "
                           "servo:let_fall returned"};
  return {{"control.identify_response",
           {options_of({measured, commanded, direction,
                        number("lag", "s", 0, 1, "of the coils, first order (10.6 ms)")})},
           {"table",
            {{"delay", "s", "from a command to the first of its effect"},
             {"delay_sigma", "s", ""},
             {"gain", "", "true response over the believed one: moment over drag"},
             {"gain_sigma", "", ""},
             {"drift", "m/s", "that the commands did not explain, at the mean place"},
             {"drift_sigma", "m/s", ""},
             {"residual", "m", "rms, of what was measured"},
             {"excitation", "m", "rms, of the motion that was commanded"}}},
           "delay and gain of the robot's response along one direction, by least squares",
           identify_response,
           "control.identify_response { measured = measured, commanded = commanded, direction = { "
           "1, 0, 0 } }"},
          {"control.identify_fall",
           {options_of({falls, number("lag", "s", 0, 1,
                                      "of the force's decay: half the coils' for a soft robot "
                                      "(10.6 ms)")})},
           {"table",
            {{"delay", "s", "from the command to the begin of the fall"},
             {"delay_sigma", "s", ""},
             {"speed", "m/s", "at which the robot sinks: weight over drag"},
             {"speed_sigma", "m/s", ""},
             {"residual", "m", "rms"},
             {"samples", "", "positions that were seen while it fell"}}},
           "how fast the robot sinks without current, and how late the coils are",
           identify_fall,
           "control.identify_fall { falls = falls }"}};
}

}  // namespace vitreo::lua
