// Bindings of field calibration: dipoles or multipoles fitted to a probe's readings.
// SPDX-License-Identifier: Apache-2.0
#include "control/field_calibration.h"
#include "control/field_fit.h"
#include "control/multipole_fit.h"
#include "host/lua/control/bind_control.h"
#include "host/lua/interpreter/calculation.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/interpreter/values.h"
#include "host/rig/field_calibration_yaml.h"

#include <stdexcept>
#include <string>
#include <utility>

namespace vitreo::lua {
namespace {

using control::FieldModel;
using control::MultipoleField;
using control::ProbeReading;

/// The option `readings`, a list of {position, currents, field} with `coils` currents each.
std::vector<ProbeReading> readings_option(const Call& call, int coils) {
  std::vector<ProbeReading> readings;
  call.push_option("readings");
  const int list = lua_gettop(call.L);
  const auto count = static_cast<lua_Integer>(lua_rawlen(call.L, list));
  for (lua_Integer i = 1; i <= count; ++i) {
    const std::string where = "readings: " + std::to_string(i) + ": ";
    if (lua_rawgeti(call.L, list, i) != LUA_TTABLE)
      throw std::invalid_argument(where + "wants a table {position, currents, field}, got " +
                                  kind_of(call.L, -1));
    refuse_unknown(call.L, lua_gettop(call.L), where, {"position", "currents", "field"});
    const OptionTable entry(call.L, lua_gettop(call.L));
    const auto position = entry.vector("position"), field = entry.vector("field");
    const auto currents = entry.numbers("currents");
    if (!position || !position->allFinite())
      throw std::invalid_argument(where + "position: wants {x, y, z} in m");
    if (!field || !field->allFinite())
      throw std::invalid_argument(where + "field: wants {x, y, z} in T");
    if (!currents || static_cast<int>(currents->size()) != coils)
      throw std::invalid_argument(where + "currents: wants " + std::to_string(coils) +
                                  " numbers in A, one a coil");
    readings.push_back(
        {*position, Eigen::Map<const Eigen::VectorXd>(currents->data(), coils), *field});
    if (!readings.back().currents.allFinite())
      throw std::invalid_argument(where + "currents: one of them is not finite");
    lua_pop(call.L, 1);
  }
  lua_pop(call.L, 1);
  return readings;
}

/// From where the fit starts: the option `start`, or an OctoMag.
FieldModel start_option(const Call& call) {
  const bool given = call.push_option("start");
  lua_pop(call.L, 1);
  return given ? call.handle_option<FieldModel>("start")
               : FieldModel(control::CoilField::octomag());
}

/// Result of either kind of fit, for one way of reporting it.
struct Fitted {
  FieldModel model;
  Eigen::Vector3d background;
  control::ResidualReport residual;
  bool converged;
  std::size_t readings;
  std::vector<control::CoilComparison> coils;  // against the start
};

/// The fitted coils against the start, at the world's origin, or at the nearest position where both
/// models hold; none where there is no such position.
std::vector<control::CoilComparison> compared(const FieldModel& fitted, const FieldModel& start) {
  // Clamping to one box and then to the other ends in both of them where they overlap.
  const Eigen::Vector3d position =
      start.nearest_valid(fitted.nearest_valid(Eigen::Vector3d::Zero()));
  if (!fitted.valid_at(position)) return {};
  return control::compare_coils(fitted, start, position);
}

/// The fitted background goes into the model, so that it predicts what the probe read. Readings
/// count from 1 in scripts.
int push_fitted(const Call& call, const Fitted& fitted) {
  FieldModel model = fitted.model;
  model.set_uniform_background(fitted.background);
  ResultTable report(call);
  push_handle(call.L, field_model_class(), std::make_shared<FieldModel>(std::move(model)));
  report.top("model")
      .number("residual_rms", fitted.residual.rms, "T")
      .number("residual_largest", fitted.residual.largest, "T")
      .number("residual_relative", fitted.residual.relative)
      .integer("worst_reading", static_cast<lua_Integer>(fitted.residual.worst + 1))
      .integer("readings", static_cast<lua_Integer>(fitted.readings))
      .vector("background", fitted.background, "T")
      .flag("converged", fitted.converged);
  add_comparison(report, fitted.coils);
  return 1;
}

/// From a model of dipoles: the moments and positions that the probe's readings ask for.
Fitted fitted_dipoles(const control::CoilField& start, const std::vector<ProbeReading>& readings) {
  const control::DipoleFit fit = control::fit_dipoles(start, readings);
  return {fit.field,
          fit.background,
          {fit.residual_rms, fit.residual_largest, fit.worst_reading, fit.residual_relative},
          fit.converged,
          readings.size(),
          compared(fit.field, start)};
}

/// From a model of dipoles the fit of multipoles starts at dipoles fitted to the readings first:
/// multipoles are sensitive to where they start.
Fitted fitted_multipoles(const FieldModel& start, int order,
                         const std::vector<ProbeReading>& readings, const YieldPoint& breath) {
  const auto from = [&]() -> MultipoleField {
    if (start.multipoles() != nullptr) return *start.multipoles();
    const control::CoilField near = control::fit_dipoles(*start.dipoles(), readings).field;
    constexpr double kAnywhere = 1;  // m: the fit's region is that of its readings
    return control::multipoles_like(
        near, order, {Eigen::Vector3d::Constant(-kAnywhere), Eigen::Vector3d::Constant(kAnywhere)});
  }();
  breath();
  const control::MultipoleFit fit = control::fit_multipoles(from, readings);
  return {fit.field,     fit.background,  fit.residual,
          fit.converged, readings.size(), compared(fit.field, start)};
}

/// Bad options and readings are refused here, before the calculation; the fit itself refuses
/// readings that determine too little, such as of a coil that never had a current.
int fit_field_model(Call& call) {
  const FieldModel start = start_option(call);
  const bool multipoles = *call.text_option("sources") == "multipoles";
  const auto order = call.number_option("order");
  if (!multipoles && start.dipoles() == nullptr)
    throw std::invalid_argument(
        "start: wants a model of dipoles, such as that of the name octomag");
  if (order && !multipoles) throw std::invalid_argument("order: is for multipoles");
  if (order && start.multipoles() != nullptr)
    throw std::invalid_argument("order: the start is of multipoles and has its own");
  return calculate(
      call, "field fit",
      [start, multipoles, order = static_cast<int>(order.value_or(2)),
       readings = readings_option(call, start.coils())](const YieldPoint& breath) {
        return multipoles ? fitted_multipoles(start, order, readings, breath)
                          : fitted_dipoles(*start.dipoles(), readings);
      },
      push_fitted);
}

/// A model as the YAML of ETH's software. Dipoles are sources of the first order, and need a region
/// to be written with.
int to_yaml(Call& call) {
  const FieldModel& model = call.self<FieldModel>();
  const auto low = call.vector_option("low"), high = call.vector_option("high");
  const auto as_multipoles = [&]() -> MultipoleField {
    if (model.multipoles() != nullptr) {
      if (low || high)
        throw std::invalid_argument("low, high: a model of multipoles has its own region");
      return *model.multipoles();
    }
    if (!low || !high)
      throw std::invalid_argument(
          "low, high: dipoles hold everywhere; say for which box to write them");
    return control::multipoles_like(*model.dipoles(), 1, {*low, *high});
  };
  const MultipoleField field = as_multipoles();
  if (!model.uniform_background().isZero(0)) {
    // A uniform background has no key of its own in the format, but is the field of a background
    // source with the coefficient A_1 alone: Psi = A_1 r P_1, uniform along the source's axis.
    const double size = model.uniform_background().norm();
    MultipoleField::Sources background = field.background_sources();
    background.push_back({{0, 0, 0}, model.uniform_background() / size, {size}, {}});
    return call.result(
        field_calibration_text({call.text_option("name").value_or(""),
                                MultipoleField(field.sources(), background, field.region())}));
  }
  return call.result(field_calibration_text({call.text_option("name").value_or(""), field}));
}

}  // namespace

/// Shared with simulation:use_calibration, which compares a measured machine with the loop's model.
std::vector<ResultField> comparison_fields() {
  return {{"sign", "", "-1 where the coil is wired the other way round"},
          {"gain", "", "of its field at 1 A"},
          {"angle", "rad", "between the axes"}};
}

/// A coil of sign -1 is wired, or counted, the other way round: a script shows it before currents
/// flow.
void add_comparison(ResultTable& report, const std::vector<control::CoilComparison>& coils) {
  report.list("coils", coils.size(), [&coils](ResultTable& entry, std::size_t i) {
    entry.number("sign", coils[i].sign).number("gain", coils[i].gain);
    entry.number("angle", coils[i].angle, "rad");
  });
}

std::vector<Binding> field_fit_functions() {
  const Argument readings{.name = "readings",
                          .type = Type::list,
                          .help = "of {position in m, currents in A, field in T}"};
  const Argument start{.name = "start",
                       .type = Type::handle,
                       .optional = true,
                       .help = "where the fit starts (that of the name octomag)",
                       .handle = "field_model"};
  const Returned fitted{"table",
                        {{"model", "", "field_model, the background included"},
                         {"residual_rms", "T", "what is left over"},
                         {"residual_largest", "T", ""},
                         {"residual_relative", "", "to the fields that were read"},
                         {"worst_reading", "", "number of the one with the largest residual"},
                         {"readings", "", "how many"},
                         {"background", "T", "uniform field without current"},
                         {"coils", "", "each as it compares with the start", comparison_fields()},
                         {"converged", "", "true or false"}}};
  return {{"control.fit_field_model",
           {options_of({readings,
                        {.name = "sources",
                         .type = Type::text,
                         .help = "of a coil: one dipole; or multipoles, from dipoles fitted first "
                                 "or from an earlier calibration, which hold in the box that the "
                                 "readings span",
                         .choices = {"dipoles", "multipoles"}},
                        start,
                        {.name = "order",
                         .type = Type::integer,
                         .optional = true,
                         .min = 1,
                         .max = control::kMaxMultipoleOrder,
                         .help = "of multipoles, where the start is of dipoles (2)"}})},
           fitted,
           "calibrates coils and a uniform background from a probe's readings, for dipoles at "
           "least 2 a coil and 1",
           fit_field_model,
           "control.fit_field_model { readings = readings, sources = \"dipoles\" }"}};
}

Binding field_text_row() {
  const auto corner = [](const char* name, const char* help) {
    return Argument{
        .name = name, .type = Type::vector, .unit = "m", .optional = true, .help = help};
  };
  return {
      "to_yaml",
      {options_of({{.name = "name", .type = Type::text, .optional = true, .help = "of the machine"},
                   corner("low", "corner of the box for which dipoles are written"),
                   corner("high", "the other")})},
      "string",
      "as YAML, the way ETH's software writes it: for files.write, and for a rig's calibration",
      to_yaml,
      "field_model:to_yaml { low = { -cm, -cm, -cm }, high = { cm, cm, cm } }"};
}

}  // namespace vitreo::lua
