// Binding of rig:identify_field: the coils' field by the robot's own motion, from the record's
// streams and the model that the loop had.
// SPDX-License-Identifier: Apache-2.0
#include "control/field_identification.h"
#include "host/lua/control/bind_control.h"
#include "host/lua/interpreter/calculation.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/rig/bind_rig.h"
#include "host/servo/servo_controller.h"

#include <Eigen/LU>

#include <memory>
#include <numbers>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace vitreo::lua {
namespace {

using control::FieldIdentification;
using control::FieldMotion;

/// Lists that are all as long as `time`: a row of numbers for each time.
std::vector<std::vector<double>> columns_of(const OptionTable& table, const std::string& where,
                                            const std::vector<std::string>& names) {
  std::vector<std::vector<double>> columns;
  for (const std::string& name : names) {
    auto values = table.numbers(name.c_str());
    if (!values || (!columns.empty() && values->size() != columns.front().size()))
      throw std::invalid_argument(where + ": " + name + ": wants a number for each time");
    columns.push_back(std::move(*values));
  }
  return columns;
}

/// Where the robot was, without the rows in which it was not seen.
std::vector<control::TimedVector> positions_of(const OptionTable& table, const std::string& where) {
  const auto columns = columns_of(table, where, {"time", "x", "y", "z"});
  std::vector<control::TimedVector> rows;
  for (std::size_t i = 0; i < columns[0].size(); ++i) {
    const Eigen::Vector3d place(columns[1][i], columns[2][i], columns[3][i]);
    if (place.allFinite()) rows.push_back({columns[0][i], place});
  }
  return rows;
}

/// A controller that has the drag beside the walls as the loop had it; it is never stepped.
std::unique_ptr<ServoController> drag_of(const RigModel& model) {
  ControllerSettings settings;
  settings.limits = control::CurrentLimits::Constant(model.field.coils(), 12);
  settings.wall_drag = model.eye.size() > 2;
  return std::make_unique<ServoController>(model, settings);
}

/// The set-points, and the mobility at the position that was measured last before each, with the
/// robot's axis along the field as it is believed: right to some degrees, whatever turned it there.
void add_commanded(FieldMotion& motion, const OptionTable& table, const std::string& where,
                   const RigModel& model) {
  std::vector<std::string> names{"time"};
  for (int k = 1; k <= model.field.coils(); ++k) names.push_back("i" + std::to_string(k));
  const auto columns = columns_of(table, where, names);
  const auto controller = drag_of(model);
  std::size_t seen = 0;
  for (std::size_t i = 0; i < columns[0].size() && !motion.measured.empty(); ++i) {
    control::TimedCurrents row{columns[0][i], control::Currents(model.field.coils())};
    for (int k = 0; k < model.field.coils(); ++k)
      row.currents[k] = columns[static_cast<std::size_t>(k) + 1][i];
    while (seen + 1 < motion.measured.size() && motion.measured[seen + 1].time <= row.time) ++seen;
    const Eigen::Vector3d place = model.field.nearest_valid(motion.measured[seen].value);
    const Eigen::Vector3d field =
        (model.field.matrix(place) * row.currents + model.field.background(place)).head<3>();
    if (field.norm() > 0) controller->set_axis(field.normalized());
    row.mobility = controller->drag_at(place).inverse();
    motion.commanded.push_back(row);
  }
}

/// The table `name` of the entry on top of the stack is given to `take`, and popped.
template <class Take>
void with_table(const Call& call, const char* name, const std::string& where, Take take) {
  if (lua_getfield(call.L, -1, name) != LUA_TTABLE)
    throw std::invalid_argument(where + ": " + name + ": wants a table of lists");
  take(OptionTable(call.L, lua_gettop(call.L)), where + ": " + name);
  lua_pop(call.L, 1);
}

/// The option `motions`, a list of {measured, currents, held_out}.
std::vector<FieldMotion> motions_option(const Call& call, const RigModel& model) {
  std::vector<FieldMotion> motions;
  call.push_option("motions");
  const int list = lua_gettop(call.L);
  const auto count = static_cast<lua_Integer>(lua_rawlen(call.L, list));
  for (lua_Integer i = 1; i <= count; ++i) {
    const std::string where = "motions: " + std::to_string(i);
    if (lua_rawgeti(call.L, list, i) != LUA_TTABLE)
      throw std::invalid_argument(where + ": wants a table {measured, currents}");
    refuse_unknown(call.L, lua_gettop(call.L), where + ": ", {"measured", "currents", "held_out"});
    const OptionTable entry(call.L, lua_gettop(call.L));
    FieldMotion motion;
    motion.held_out = entry.flag("held_out");
    with_table(call, "measured", where, [&](const OptionTable& table, const std::string& name) {
      motion.measured = positions_of(table, name);
    });
    with_table(call, "currents", where, [&](const OptionTable& table, const std::string& name) {
      add_commanded(motion, table, name, model);
    });
    motions.push_back(std::move(motion));
    lua_pop(call.L, 1);
  }
  lua_pop(call.L, 1);
  return motions;
}

/// The coils' field of the rig's model as one dipole each.
control::DipoleModel believed_dipoles(const RigModel& model) {
  const auto dipoles = control::dipoles_of(model.field);
  if (!dipoles)
    throw std::invalid_argument(
        "the rig's field model has more than one dipole a coil: a motion cannot tell so many "
        "numbers; calibrate it with a field probe");
  return *dipoles;
}

void push_unexplained(ResultTable& report, const char* name, const control::Unexplained& found) {
  report.table(name, [&found](ResultTable& table) {
    table.number("before", found.before, "m/s").number("after", found.after, "m/s");
    table.integer("displacements", found.rows);
  });
}

void push_model(ResultTable& report, lua_State* L, const char* name,
                const control::DipoleModel& dipoles) {
  auto model = std::make_shared<control::FieldModel>(dipoles.field);
  model->set_uniform_background(dipoles.background);
  push_handle(L, field_model_class(), model);
  report.top(name);
}

int push_found(const Call& call, const FieldIdentification& found,
               const control::DipoleModel& believed) {
  ResultTable report(call);
  push_model(report, call.L, "model", {found.field, believed.background + found.background});
  push_model(report, call.L, "believed", believed);
  report.vector("background", found.background, "T")
      .number("response", found.response.value)
      .number("response_sigma", found.response.sigma)
      .number("sink", found.sink.value)
      .number("sink_sigma", found.sink.sigma)
      .number("direction_believed", found.direction_believed, "rad")
      .number("direction_sigma", found.direction_sigma, "rad")
      .matrix("covariance", found.covariance)
      .list("coils", found.coils.size(), [&found](ResultTable& entry, std::size_t i) {
        const control::IdentifiedCoil& coil = found.coils[i];
        entry.number("gain", coil.gain.value)
            .number("gain_sigma", coil.gain.sigma)
            .number("gain_believed", coil.gain_believed)
            .number("angle", coil.angle, "rad")
            .number("angle_sigma", coil.angle_sigma, "rad")
            .number("angle_believed", coil.angle_believed, "rad");
      });
  push_unexplained(report, "fitted", found.fitted);
  push_unexplained(report, "held_out", found.held_out);
  return 1;
}

/// Off the script's task: a minute of motion is some second of a processor.
int identify_field(Call& call) {
  const RigModel& model = call.self<Rig>().model;
  const control::DipoleModel believed = believed_dipoles(model);
  control::FieldDoubt doubt;
  doubt.noise = call.number_option("noise").value_or(doubt.noise);
  doubt.unexplained = call.number_option("unexplained").value_or(doubt.unexplained);
  doubt.check();
  const double lag = 1 / (2 * std::numbers::pi * model.command_bandwidth);
  return calculate(
      call, "identification",
      [believed, doubt, robot = model.robot, medium = model.medium,
       delay = model.command_delay + lag,
       motions = motions_option(call, model)](const YieldPoint&) {
        return control::identify_field(believed.field, robot, medium, motions, delay, doubt,
                                       believed.background);
      },
      [believed](const Call& done, const FieldIdentification& found) {
        return push_found(done, found, believed);
      });
}

Returned found_fields() {
  const std::vector<ResultField> unexplained{{"before", "m/s", "of the model as it was"},
                                             {"after", "m/s", "of the one found"},
                                             {"displacements", "", "how many, of half a second"}};
  return {
      "table",
      {{"model", "", "field_model, the background included"},
       {"believed", "", "field_model, as it was"},
       {"background", "T", "uniform, beyond the believed one"},
       {"response", "", "true magnetic velocity over the believed: moment over drag"},
       {"response_sigma", "", ""},
       {"sink", "", "true sinking speed over the believed: weight over drag"},
       {"sink_sigma", "", ""},
       {"direction_believed", "rad",
        "of either coordinate of the field's direction at the currents in use: one sigma before"},
       {"direction_sigma", "rad", "and after"},
       {"coils",
        "",
        "each, by its field in the middle of the motion",
        {{"gain", "", "of its strength, over the believed"},
         {"gain_sigma", "", ""},
         {"gain_believed", "", "its sigma before: what is no smaller now was not told"},
         {"angle", "rad", "between its direction and the believed"},
         {"angle_sigma", "rad", "of either coordinate across"},
         {"angle_believed", "rad", "its sigma before"}}},
       {"covariance", "",
        "list of rows: of a coil's moment along and twice across and its place, of all coils, "
        "background, response and sink, over their sigmas before"},
       {"fitted", "", "velocity that is not explained, rms of a coordinate", unexplained},
       {"held_out", "", "the same of the motions that were not fitted", unexplained}}};
}

}  // namespace

std::vector<Binding> rig_field_rows() {
  const Argument motions{
      .name = "motions",
      .type = Type::list,
      .help =
          "of {measured, currents, held_out}: lists time, x, y, z of the stream servo; "
          "time, i1, i2 and on of the stream currents, by the time of their decision; "
          "whether the stretch only judges the result"};
  return {{"identify_field",
           {options_of({motions, number_option("noise", "m", 1e-9, 1e-3, "of a coordinate (5 um)"),
                        number_option("unexplained", "m/s", 1e-9, 1e-2,
                                      "of a coordinate, over half a second, that is neither noise "
                                      "nor the coils (5 um/s)")})},
           found_fields(),
           "what of the coils' field differs from the model, by the robot's own motion",
           identify_field,
           "rig:identify_field { motions = motions }"}};
}

}  // namespace vitreo::lua
