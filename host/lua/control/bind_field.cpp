// field_model: what currents make, and which currents make what is wanted.
// SPDX-License-Identifier: Apache-2.0
#include "control/box_allocation.h"
#include "control/field_fit.h"
#include "control/robots.h"
#include "control/stability.h"
#include "control/workspace_map.h"
#include "host/lua/control/bind_control.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/interpreter/values.h"
#include "host/rig/field_calibration_yaml.h"

#include <stdexcept>
#include <string>
#include <utility>

namespace vitreo::lua {
namespace {

using control::FieldModel;

constexpr double kCurrentLimit = 12;  // A

int push_model(const Call& call, FieldModel model) {
  push_handle(call.L, field_model_class(), std::make_shared<FieldModel>(std::move(model)));
  return 1;
}

int octomag(Call& call) { return push_model(call, control::CoilField::octomag()); }
int field_calibration(Call& call) {
  control::FieldCalibration read = parse_field_calibration(call.text(0));
  if (const auto& show = call.context().print)
    for (const std::string& warning : read.warnings) show("field_calibration: " + warning);
  return push_model(call, std::move(read.field));
}

int robots(Call& call) {
  lua_newtable(call.L);
  lua_Integer n = 0;
  for (const std::string_view name : control::robot_names()) {
    lua_pushlstring(call.L, name.data(), name.size());
    lua_rawseti(call.L, -2, ++n);
  }
  return 1;
}

int robot(Call& call) {
  const control::Robot robot = control::robot_named(call.text(0));
  control::Medium medium;
  medium.density = call.number_option("density").value_or(medium.density);
  medium.kinematic_viscosity =
      call.number_option("kinematic_viscosity").value_or(medium.kinematic_viscosity);
  medium.check();
  const double field = call.number_option("field").value_or(10e-3);
  const Eigen::Matrix3d drag = control::resistance(robot, medium, Eigen::Vector3d::UnitX());
  push_fields(call.L, {{"semi_axis", robot.semi_axis},
                       {"semi_radius", robot.semi_radius},
                       {"mass", robot.mass()},
                       {"net_weight", robot.net_weight(medium)},
                       {"moment", robot.moment(field)},
                       {"drag_along", drag(0, 0)},
                       {"drag_across", drag(1, 1)}});
  return 1;
}

control::Currents currents_at(const Call& call, std::size_t argument, const FieldModel& model) {
  const std::vector<double> given = call.numbers(argument);
  if (static_cast<int>(given.size()) != model.coils())
    throw std::invalid_argument("currents: wants " + std::to_string(model.coils()) + " numbers");
  return Eigen::Map<const Eigen::VectorXd>(given.data(), model.coils());
}

int coils(Call& call) { return call.result(call.self<FieldModel>().coils()); }

int valid_at(Call& call) {
  lua_pushboolean(call.L, call.self<FieldModel>().valid_at(call.vector(0)));
  return 1;
}

int field(Call& call) {
  const FieldModel& model = call.self<FieldModel>();
  const Eigen::Vector3d place = call.vector(0);
  const control::FieldGradient made =
      model.matrix(place) * currents_at(call, 1, model) + model.background(place);
  push_vector(call.L, made.head<3>());
  const Eigen::Matrix3d gradient = control::gradient_matrix(made);
  lua_createtable(call.L, 3, 0);
  for (int row = 0; row < 3; ++row) {
    push_vector(call.L, gradient.row(row));
    lua_rawseti(call.L, -2, row + 1);
  }
  return 2;
}

int set_background(Call& call) {
  call.self<FieldModel>().set_uniform_background(call.vector(0));
  return 0;
}

control::CurrentLimits limits_option(const Call& call, int coils) {
  control::CurrentLimits limits =
      control::CurrentLimits::Constant(coils, call.number_option("limit").value_or(kCurrentLimit));
  for (const double channel : call.numbers_option("dead").value_or(std::vector<double>{})) {
    if (!(channel >= 1 && channel <= coils))
      throw std::invalid_argument("dead: wants numbers of coils, from 1");
    limits[static_cast<int>(channel) - 1] = 0;
  }
  return limits;
}

int allocate(Call& call) {
  const FieldModel& model = call.self<FieldModel>();
  const Eigen::Vector3d place = *call.vector_option("position"),
                        field = *call.vector_option("field"),
                        force = call.vector_option("force").value_or(Eigen::Vector3d::Zero());
  if (!(field.norm() > 0)) throw std::invalid_argument("field: wants one that is not zero");
  const control::Robot robot = control::robot_named(call.text_option("robot").value_or("coni_2mm"));
  const Eigen::Vector3d moment = robot.moment(field.norm()) * field.normalized();
  const control::CurrentLimits limits = limits_option(call, model.coils());
  const control::FieldMatrix matrix = model.matrix(place);
  const control::FieldGradient background = model.background(place);
  const Eigen::Vector3d pulled = control::force_from_field(moment) * background;
  const Eigen::Vector3d levitation(0, 0, robot.net_weight(control::Medium{}));
  const auto found = control::allocate_within(
      matrix, moment, {field - background.head<3>(), levitation - pulled, force}, limits);
  push_fields(call.L, {{"headroom", found.headroom},
                       {"condition", control::condition_number(matrix, moment, limits)}});
  push_numbers(call.L, {found.currents.begin(), found.currents.end()});
  lua_setfield(call.L, -2, "currents");
  push_vector(call.L, found.field + background.head<3>());
  lua_setfield(call.L, -2, "field");
  push_vector(call.L, found.force + pulled - levitation);
  lua_setfield(call.L, -2, "force");
  lua_pushboolean(call.L, found.limited || found.vertical_cut);
  lua_setfield(call.L, -2, "limited");
  return 1;
}

int instability(Call& call) {
  const FieldModel& model = call.self<FieldModel>();
  const control::Robot robot = control::robot_named(call.text_option("robot").value_or("coni_2mm"));
  return call.result(control::instability(model, robot, control::Medium{},
                                          currents_at(call, 1, model), call.vector(0)));
}

int workspace_map(Call& call) {
  control::MapRequest request;
  request.low = call.vector_option("low").value_or(request.low);
  request.high = call.vector_option("high").value_or(request.high);
  request.field = call.vector_option("field").value_or(request.field);
  if (const auto points = call.vector_option("points")) request.points = points->cast<int>();
  const FieldModel& model = call.self<FieldModel>();
  request.limits = limits_option(call, model.coils());
  const auto map = control::workspace_map(model, request);
  lua_createtable(call.L, static_cast<int>(map.size()), 0);
  for (std::size_t i = 0; i < map.size(); ++i) {
    push_fields(
        call.L,
        {{"field", map[i].field}, {"force", map[i].force}, {"condition", map[i].condition}});
    push_vector(call.L, map[i].position);
    lua_setfield(call.L, -2, "position");
    lua_rawseti(call.L, -2, static_cast<lua_Integer>(i) + 1);
  }
  return 1;
}

std::vector<Argument> limit_options() {
  return {{.name = "limit",
           .type = Type::number,
           .unit = "A",
           .optional = true,
           .min = 0.01,
           .max = 100,
           .help = "of each coil (12 A)"},
          {.name = "dead",
           .type = Type::numbers,
           .optional = true,
           .help = "coils without current, from 1"}};
}

Argument vector_named(const char* name, const char* unit, bool optional, const char* help = "") {
  return {.name = name, .type = Type::vector, .unit = unit, .optional = optional, .help = help};
}

Argument robot_argument(const char* name, bool optional) {
  const auto& known = control::robot_names();
  return {.name = name,
          .type = Type::text,
          .optional = optional,
          .help = optional ? "whose moment it is (coni_2mm)" : "its name",
          .choices = {known.begin(), known.end()}};
}

std::vector<Binding> model_rows() {
  const Argument place = vector_named("position", "m", false);
  const Argument currents{.name = "currents", .type = Type::numbers, .unit = "A"};
  return {
      {"coils", {}, "number", "of coils", coils},
      {"valid_at", {place}, "true or false", "whether the model holds there", valid_at},
      {"field",
       {place, currents},
       "field in T, rows of its gradient in T/m",
       "what currents make there, the background included",
       field},
      {"set_background",
       {vector_named("field", "T", false, "uniform: the earth and the neighbors")},
       "",
       "sets the field that is there without current, besides the model's own",
       set_background},
      {"allocate",
       {options_of(
           {place, vector_named("field", "T", false, "wanted; the robot's axis lies along it"),
            vector_named("force", "N", true, "wanted besides levitation in silicone oil"),
            robot_argument("robot", true)},
           limit_options())},
       "table",
       "currents, field, force, headroom, condition, limited: the vertical force first (thesis "
       "2.3)",
       allocate},
      {"instability",
       {place, currents, options_of({robot_argument("robot", true)})},
       "number in 1/s",
       "how fast a robot runs away there in constant currents (Earnshaw)",
       instability},
      {"workspace_map",
       {options_of({vector_named("low", "m", true, "corner ({-10, -10, -10} mm)"),
                    vector_named("high", "m", true, "corner ({10, 10, 10} mm)"),
                    vector_named("points", "", true, "along each axis ({5, 5, 5})"),
                    vector_named("field", "T", true, "held while force is made ({10, 0, 0} mT)")},
                   limit_options())},
       "list of tables",
       "position, field in T, force over moment in T/m, condition: what can be had in the worst "
       "direction",
       workspace_map},
      field_text_row()};
}

}  // namespace

std::vector<Binding> field_functions() {
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
  return {
      {"control.octomag", {}, "field_model", "an OctoMag as one dipole a coil", octomag},
      {"control.field_calibration",
       {{.name = "text", .type = Type::text, .help = "YAML, as ETH's software writes it"}},
       "field_model",
       "a measured calibration: multipoles",
       field_calibration},
      {"control.robots", {}, "list of names", "the robots that are known", robots},
      {"control.robot",
       {robot_argument("name", false),
        options_of({number("field", "T", 1e-6, 1, "for the moment (10 mT)"),
                    number("density", "kg/m^3", 1, 3000, "of the fluid (970)"),
                    number("kinematic_viscosity", "m^2/s", 1e-7, 1, "of the fluid (500 cSt)")})},
       "table",
       "semi_axis, semi_radius, mass, net_weight, moment, drag_along, drag_across",
       robot}};
}

const Class& field_model_class() {
  static const Class kind{
      "field_model", "the field of a set of coils; make one with control.octomag", model_rows()};
  return kind;
}

}  // namespace vitreo::lua
