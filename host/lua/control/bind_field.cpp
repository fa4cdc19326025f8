// Bindings of field_model: the field of given currents, and the allocation of currents.
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

/// Each handle owns its model: a model is a value, and nothing changes it once it is made.
int push_model(const Call& call, FieldModel model) {
  push_handle(call.L, field_model_class(), std::make_shared<FieldModel>(std::move(model)));
  return 1;
}

/// What a laboratory's file says; warnings, such as of a key that is not understood, go to whoever
/// runs the script, since the model may not be the one that the file's author meant.
FieldModel calibrated_model(const Call& call, const std::string& text) {
  control::FieldCalibration read = parse_field_calibration(text);
  if (const auto& show = call.context().print)
    for (const std::string& warning : read.warnings) show("field_model: " + warning);
  return std::move(read.field);
}

/// A machine known by its name, or a measured one; the background of either is given here and not
/// set later, so that a model that a servo or a plot holds stays what it was.
int field_model(Call& call) {
  const auto name = call.text_option("name"), calibration = call.text_option("calibration");
  if (name.has_value() == calibration.has_value())
    throw std::invalid_argument("options: wants either name or calibration");
  FieldModel model = calibration ? calibrated_model(call, *calibration)
                                 : FieldModel(control::CoilField::octomag());
  if (const auto background = call.vector_option("background"))
    model.set_uniform_background(*background);
  return push_model(call, std::move(model));
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

/// Moment at that field, weight less buoyancy and drag in that fluid. Drag is the diagonal of the
/// resistance matrix with the robot's axis along x.
int robot(Call& call) {
  const control::Robot robot = control::robot_named(*call.text_option("name"));
  control::Medium medium;
  medium.density = call.number_option("density").value_or(medium.density);
  medium.kinematic_viscosity =
      call.number_option("kinematic_viscosity").value_or(medium.kinematic_viscosity);
  medium.check();
  const double field = call.number_option("field").value_or(10e-3);
  const Eigen::Matrix3d drag = control::resistance(robot, medium, Eigen::Vector3d::UnitX());
  ResultTable(call)
      .number("semi_axis", robot.semi_axis, "m")
      .number("semi_radius", robot.semi_radius, "m")
      .number("mass", robot.mass(), "kg")
      .number("net_weight", robot.net_weight(medium), "N")
      .number("moment", robot.moment(field), "A m^2")
      .number("drag_along", drag(0, 0), "N s/m")
      .number("drag_across", drag(1, 1), "N s/m");
  return 1;
}

/// The option `currents`, one a coil: A.
control::Currents currents_option(const Call& call, const FieldModel& model) {
  const std::vector<double> given = *call.numbers_option("currents");
  if (static_cast<int>(given.size()) != model.coils())
    throw std::invalid_argument("currents: wants " + std::to_string(model.coils()) + " numbers");
  return Eigen::Map<const Eigen::VectorXd>(given.data(), model.coils());
}

/// Dipoles hold everywhere: no region. Multipoles diverge outside of the box they were fitted in.
int model_info(Call& call) {
  const auto& model = call.self<FieldModel>();
  ResultTable table(call);
  table.integer("coils", model.coils()).vector("background", model.uniform_background(), "T");
  if (const auto* multipoles = model.multipoles())
    table.table("region", [&region = multipoles->region()](ResultTable& box) {
      box.vector("low", region.low, "m").vector("high", region.high, "m");
    });
  return 1;
}

/// With a robot also the growth rate of what runs away from there (Earnshaw 1842: no constant field
/// holds it).
int field(Call& call) {
  const auto& model = call.self<FieldModel>();
  const Eigen::Vector3d place = *call.vector_option("position");
  const control::Currents currents = currents_option(call, model);
  const control::FieldGradient made = model.matrix(place) * currents + model.background(place);
  ResultTable table(call);
  table.vector("field", made.head<3>(), "T")
      .matrix("gradient", control::gradient_matrix(made), "T/m");
  if (const auto robot = call.text_option("robot"))
    table.number("instability",
                 control::instability(model, control::robot_named(*robot), control::Medium{},
                                      currents, place),
                 "1/s");
  return 1;
}

/// A dead coil has a limit of 0: the others take over its part.
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

/// Thesis 2.3: [B; F] = A I for the least currents, within limits (control::allocate_within). The
/// vertical force, which carries the robot, is met first.
int allocate(Call& call) {
  const FieldModel& model = call.self<FieldModel>();
  const Eigen::Vector3d place = *call.vector_option("position"),
                        field = *call.vector_option("field"),
                        force = call.vector_option("force").value_or(Eigen::Vector3d::Zero());
  if (!(field.norm() > 0)) throw std::invalid_argument("field: wants one that is not zero");
  const control::Robot robot = control::robot_named(call.text_option("robot").value_or("coni_2mm"));
  // The robot turns until its moment lies along the field, so the field wanted gives the direction.
  const Eigen::Vector3d moment = robot.moment(field.norm()) * field.normalized();
  const control::CurrentLimits limits = limits_option(call, model.coils());
  const control::FieldMatrix matrix = model.matrix(place);
  const control::FieldGradient background = model.background(place);
  // The background makes field and force without current: the coils have to make only the rest, and
  // what is reported is what acts on the robot, both together, less the levitation.
  const Eigen::Vector3d pulled = control::force_from_field(moment) * background;
  const Eigen::Vector3d levitation(0, 0, robot.net_weight(control::Medium{}));
  const auto found = control::allocate_within(
      matrix, moment, {field - background.head<3>(), levitation - pulled, force}, limits);
  ResultTable(call)
      .number("headroom", found.headroom)
      .number("condition", control::condition_number(matrix, moment, limits))
      .numbers("currents", {found.currents.begin(), found.currents.end()}, "A")
      .vector("field", found.field + background.head<3>(), "T")
      .vector("force", found.force + pulled - levitation, "N")
      .flag("limited", found.limited || found.vertical_cut);
  return 1;
}

/// Over a grid, the worst direction of each place: what a protocol may ask for anywhere near it.
int workspace_map(Call& call) {
  control::MapRequest request;
  request.low = call.vector_option("low").value_or(request.low);
  request.high = call.vector_option("high").value_or(request.high);
  request.field = call.vector_option("field").value_or(request.field);
  if (const auto points = call.vector_option("points")) request.points = points->cast<int>();
  const FieldModel& model = call.self<FieldModel>();
  request.limits = limits_option(call, model.coils());
  const auto map = control::workspace_map(model, request);
  return push_result_list(call, map.size(), [&map](ResultTable& entry, std::size_t i) {
    entry.vector("position", map[i].position, "m")
        .number("field", map[i].field, "T")
        .number("force", map[i].force, "T/m")
        .number("condition", map[i].condition);
  });
}

/// Of allocate and workspace_map alike, so that a map tells what an allocation can do.
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

/// A robot by its name: the choices are those of control.robots.
Argument robot_argument(const char* name, bool optional) {
  const auto& known = control::robot_names();
  return {.name = name,
          .type = Type::text,
          .optional = optional,
          .help = optional ? "whose moment it is (coni_2mm)" : "its name",
          .choices = {known.begin(), known.end()}};
}

Returned allocation_fields() {
  return {"table",
          {{"currents", "A", "of each coil"},
           {"field", "T", "that they make"},
           {"force", "N", "besides levitation"},
           {"headroom", "", "1 - largest current over its limit"},
           {"condition", "", "condition number of the allocation's matrix"},
           {"limited", "", "whether a limit cost something of field or force"}}};
}

std::vector<Binding> model_rows() {
  const Argument place = vector_named("position", "m", false);
  const Argument currents{.name = "currents", .type = Type::numbers, .unit = "A"};
  Argument runaway = robot_argument("robot", true);
  runaway.help = "whose instability is asked for, in silicone oil";
  return {
      {"info",
       {},
       {"table",
        {{"coils", "", "how many"},
         {"background", "T", "uniform field without current, besides a calibration's own"},
         {.name = "region",
          .help = "the box where the model holds; nil: everywhere",
          .fields = {{"low", "m", "corner"}, {"high", "m", "corner"}},
          .optional = true}}},
       "coils, background and region",
       model_info,
       "field_model:info()"},
      {"field",
       {options_of({place, currents, runaway})},
       {"table",
        {{"field", "T", "the background included"},
         {"gradient", "T/m", "list of its three rows"},
         {.name = "instability",
          .unit = "1/s",
          .help = "how fast the robot runs away there in constant currents (Earnshaw)",
          .optional = true}}},
       "field and gradient that currents make there",
       field,
       "field_model:field { position = { 0, 0, 0 }, currents = { 1, 0, 0, 0, 0, 0, 0, 0 } }"},
      {"allocate",
       {options_of(
           {place, vector_named("field", "T", false, "wanted; the robot's axis lies along it"),
            vector_named("force", "N", true, "wanted besides levitation in silicone oil"),
            robot_argument("robot", true)},
           limit_options())},
       allocation_fields(),
       "the currents for a field and a force, the vertical force first (thesis 2.3)",
       allocate,
       "field_model:allocate { position = { 0, 0, 0 }, field = { 10 * mT, 0, 0 } }"},
      {"workspace_map",
       {options_of({vector_named("low", "m", true, "corner ({-10, -10, -10} mm)"),
                    vector_named("high", "m", true, "corner ({10, 10, 10} mm)"),
                    vector_named("points", "", true, "along each axis ({5, 5, 5})"),
                    vector_named("field", "T", true, "held while force is made ({10, 0, 0} mT)")},
                   limit_options())},
       {"list of tables",
        {{"position", "m", ""},
         {"field", "T", "in the worst direction"},
         {"force", "T/m", "over the moment, in the worst direction"},
         {"condition", "", "condition number"}}},
       "the fields and forces that can be had in the worst direction",
       workspace_map,
       "field_model:workspace_map { points = { 2, 2, 1 } }"},
      field_text_row()};
}

}  // namespace

std::vector<Binding> field_functions() {
  const auto number = number_option;
  const Argument model_name{.name = "name",
                            .type = Type::text,
                            .optional = true,
                            .help = "of a known machine, as one dipole a coil",
                            .choices = {"octomag"}};
  return {
      {"control.field_model",
       {options_of({model_name,
                    {.name = "calibration",
                     .type = Type::text,
                     .optional = true,
                     .help = "a measured one: multipoles as YAML, as ETH's software writes it"},
                    vector_named("background", "T", true,
                                 "uniform field without current: the earth's and the neighbors', "
                                 "besides a calibration's own ({0, 0, 0})")})},
       "field_model",
       "the field of a set of coils, known by name or from a calibration",
       field_model,
       "control.field_model { name = \"octomag\" }"},
      {"control.robots",
       {},
       "list of names",
       "the robots that are known",
       robots,
       "control.robots()"},
      {"control.robot",
       {options_of({robot_argument("name", false),
                    number("field", "T", 1e-6, 1, "for the moment (10 mT)"),
                    number("density", "kg/m^3", 1, 3000, "of the fluid (970)"),
                    number("kinematic_viscosity", "m^2/s", 1e-7, 1, "of the fluid (500 cSt)")})},
       {"table",
        {{"semi_axis", "m", "along its axis"},
         {"semi_radius", "m", "across"},
         {"mass", "kg", ""},
         {"net_weight", "N", "less what the fluid bears"},
         {"moment", "A m^2", "magnetic"},
         {"drag_along", "N s/m", "force over velocity along its axis"},
         {"drag_across", "N s/m", "and across"}}},
       "size, weight, moment and drag of a robot",
       robot,
       "control.robot { name = \"coni_2mm\" }"}};
}

const Class& field_model_class() {
  static const Class kind{"field_model",
                          "the field of a set of coils; make one with control.field_model",
                          model_rows()};
  return kind;
}

}  // namespace vitreo::lua
