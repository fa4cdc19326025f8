// Bindings of optical_system: its parameters, eyes made by them, and its prescription as rows.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/values.h"
#include "host/lua/optics/bind_optics.h"
#include "optics/system/prescription_rows.h"
#include "optics/system/surface_fields.h"

#include <cmath>
#include <stdexcept>
#include <utility>

namespace vitreo::lua {
namespace {

using optics::PrescriptionRow;

/// Numbers of a row, by their names in scripts.
struct Column {
  const char* name;
  double PrescriptionRow::*value;
  const char* unit;
};
constexpr Column kColumns[] = {{"radius", &PrescriptionRow::radius, "m"},
                               {"conic", &PrescriptionRow::conic, ""},
                               {"thickness", &PrescriptionRow::thickness, "m"},
                               {"index", &PrescriptionRow::index, ""},
                               {"semi_diameter", &PrescriptionRow::semi_diameter, "m"}};
constexpr const char* kAspheric[] = {"a4", "a6", "a8", "a10"};

/// What is as usual is left out, so that a table reads as the thesis' does.
void set_row(ResultTable& table, const PrescriptionRow& row) {
  const PrescriptionRow usual;
  table.text("surface", row.surface).text("medium", row.medium);
  for (const auto& [name, column, unit] : kColumns)
    if (row.*column != usual.*column) table.number(name, row.*column, unit);
  for (std::size_t i = 0; i < 4; ++i)
    if (row.aspheric[i] != 0) table.number(kAspheric[i], row.aspheric[i]);
  for (const optics::SurfaceField& field : optics::surface_fields())
    if (field.value(row) != 0)
      // Powers of 1/m are declared without a unit: no script writes them with one.
      table.number(
          field.name, field.value(row),
          std::string_view(field.unit).starts_with("m^") || std::string_view(field.unit) == "1"
              ? ""
              : field.unit);
  if (row.dispersion != usual.dispersion)
    table.text("dispersion", optics::to_string(row.dispersion));
}

/// An optional number of a table; `where` names the table in the error.
double number_field(lua_State* L, int index, const char* name, double usual,
                    const std::string& where) {
  const int type = lua_getfield(L, index, name);
  if (type != LUA_TNIL && type != LUA_TNUMBER)
    throw std::invalid_argument(where + name + ": wants a number, got " + kind_of(L, -1));
  const double value = type == LUA_TNIL ? usual : lua_tonumber(L, -1);
  lua_pop(L, 1);
  return value;
}

/// A row that a script wrote down; a misspelt key is an error, since it would leave a default in
/// its place and the eye would be another one.
PrescriptionRow row_at(lua_State* L, int index, const std::string& where) {
  if (!lua_istable(L, index))
    throw std::invalid_argument(where + "wants a table, got " + kind_of(L, index));
  std::vector<std::string> known{"surface", "medium", "dispersion"};
  for (const optics::SurfaceField& field : optics::surface_fields()) known.emplace_back(field.name);
  for (const Column& column : kColumns) known.emplace_back(column.name);
  for (const char* name : kAspheric) known.emplace_back(name);
  refuse_unknown(L, index, where, known);
  PrescriptionRow row;
  row.surface = text_field(L, index, "surface", where, false);
  row.medium = text_field(L, index, "medium", where, false);
  for (const auto& [name, column, unit] : kColumns)
    row.*column = number_field(L, index, name, row.*column, where);
  for (std::size_t i = 0; i < 4; ++i)
    row.aspheric[i] = number_field(L, index, kAspheric[i], 0, where);
  for (const optics::SurfaceField& field : optics::surface_fields())
    field.of(row) = number_field(L, index, field.name, 0, where);
  const std::string dispersion = text_field(L, index, "dispersion", where, false);
  if (!dispersion.empty()) row.dispersion = optics::dispersion_named(dispersion);
  return row;
}

/// A stop that is no surface of its own: in the vertex plane of that surface. Whole numbers only,
/// as Lua's 2.0 and 2 are one.
void read_stop(lua_State* L, int index, optics::PrescriptionTable& table) {
  if (lua_getfield(L, index, "stop") != LUA_TNIL) {
    if (!lua_istable(L, -1))
      throw std::invalid_argument("stop: wants a table, got " + kind_of(L, -1));
    const int stop = lua_gettop(L);
    refuse_unknown(L, stop, "stop.", {"surface", "radius"});
    const double surface = number_field(L, stop, "surface", 0, "stop.");
    if (!(surface >= 1 && surface <= 1000 && surface == std::floor(surface)))
      throw std::invalid_argument("stop.surface: wants the number of a surface; the retina is 1");
    table.stop_surface = static_cast<int>(surface);
    table.stop_radius = number_field(L, stop, "radius", 0, "stop.");
  }
  lua_pop(L, 1);
}

/// Parameters by the names that optical_system:with takes.
int system_info(Call& call) {
  const optics::Prescription& eye = eye_of(call);
  const optics::PrescriptionTable rows = optics::to_rows(eye);
  ResultTable table(call);
  table.text("name", eye.name).text("title", eye.title).text("source", rows.source);
  lua_newtable(call.L);
  for (const optics::Parameter& parameter : optics::parameters(eye))
    set_number(call.L, parameter.name.c_str(), parameter.value);  // an infinite radius is a plane
  table.top("parameters");
  return 1;
}

/// First the eye accommodates, then parameters are replaced: a value that is given stands, whatever
/// accommodation would have made of it.
int with(Call& call) {
  const int table = call.index(0);
  double accommodation = 0;
  std::vector<optics::Override> overrides;
  for (const std::string& key : text_keys(call.L, table)) {
    if (lua_getfield(call.L, table, key.c_str()) != LUA_TNUMBER)
      throw std::invalid_argument(key + ": wants a number, got " + kind_of(call.L, -1));
    const double value = lua_tonumber(call.L, -1);
    if (key == "accommodation")
      accommodation = value;
    else
      overrides.emplace_back(key, value);
    lua_pop(call.L, 1);
  }
  optics::Prescription eye = eye_of(call);
  if (accommodation != 0) eye = optics::accommodate(std::move(eye), accommodation);
  push_system(call.L, optics::with_parameters(std::move(eye), overrides));
  return 1;
}

/// Every bit comes back by optics.system: numbers are copied, never printed.
int prescription(Call& call) {
  const optics::PrescriptionTable rows = optics::to_rows(eye_of(call));
  ResultTable table(call);
  table.text("name", rows.name).text("title", rows.title).text("source", rows.source);
  if (rows.wavelength != optics::kReferenceWavelength)
    table.number("wavelength", rows.wavelength, "m");
  // 0: there is no stop.
  if (rows.stop_surface > 0)
    table.table("stop", [&rows](ResultTable& stop) {
      stop.integer("surface", rows.stop_surface).number("radius", rows.stop_radius, "m");
    });
  table.list("rows", rows.rows.size(),
             [&rows](ResultTable& row, std::size_t i) { set_row(row, rows.rows[i]); });
  return 1;
}

}  // namespace

/// from_rows judges the whole: surfaces that cross, an index below 1.
optics::Prescription prescription_table_at(lua_State* L, int index) {
  optics::PrescriptionTable table;
  table.name = text_field(L, index, "name", "", false);
  table.title = text_field(L, index, "title", "", false);
  table.source = text_field(L, index, "source", "", false);
  read_stop(L, index, table);
  table.wavelength = number_field(L, index, "wavelength", table.wavelength, "");
  if (lua_getfield(L, index, "rows") != LUA_TTABLE)
    throw std::invalid_argument("rows: wants a list of surfaces, got " + kind_of(L, -1));
  const int list = lua_gettop(L);
  for (lua_Integer i = 1; i <= static_cast<lua_Integer>(lua_rawlen(L, list)); ++i) {
    lua_rawgeti(L, list, i);
    table.rows.push_back(row_at(L, lua_gettop(L), "rows: surface " + std::to_string(i) + ": "));
    lua_pop(L, 1);
  }
  lua_pop(L, 1);
  return optics::from_rows(table);
}

std::vector<Binding> system_table_rows() {
  const auto usual = [](const char* name, const char* unit, const char* help) {
    return ResultField{.name = name, .unit = unit, .help = help, .optional = true};
  };
  const Returned prescription_fields{
      "table",
      {{"name", "", ""},
       {"title", "", ""},
       {"source", "", ""},
       {.name = "wavelength",
        .unit = "m",
        .help = "that the indices are for (589.3 nm)",
        .optional = true},
       {.name = "stop",
        .help = "the aperture stop, where it is no surface of its own",
        .fields = {{"surface", "", "its number; the retina is 1"}, {"radius", "m", ""}},
        .optional = true},
       {"rows",
        "",
        "surfaces from the retina outwards; what is as usual is left out",
        {{"surface", "", "name"},
         {"medium", "", "behind it"},
         usual("radius", "m", "of curvature (a plane)"),
         usual("conic", "", "(0)"),
         usual("thickness", "m", "to the next"),
         usual("index", "", "of the medium"),
         usual("semi_diameter", "m", "of the clear aperture"),
         usual("a4", "", "aspheric term, SI"),
         usual("a6", "", "aspheric term, SI"),
         usual("a8", "", "aspheric term, SI"),
         usual("a10", "", "aspheric term, SI"),
         usual("radius_y", "m", "of a toric surface, along its y"),
         usual("conic_y", "", "likewise"),
         usual("decenter_x", "m", "of the vertex, eye frame"),
         usual("decenter_y", "m", "likewise"),
         usual("decenter_z", "m", "likewise"),
         usual("tilt_x", "rad", "about x, then y, then z"),
         usual("tilt_y", "rad", "likewise"),
         usual("tilt_z", "rad", "likewise"),
         usual("gradient_r2", "", "of the medium's index by r^2, SI"),
         usual("gradient_r4", "", "by r^4"),
         usual("gradient_r6", "", "by r^6"),
         usual("gradient_z1", "", "by z, along the axis"),
         usual("gradient_z2", "", "by z^2"),
         usual("gradient_z3", "", "by z^3"),
         usual("gradient_z4", "", "by z^4"),
         usual("dispersion", "", "the medium's model: navarro_lens, water, ...")}}}};
  return {{"info",
           {},
           {"table",
            {{"name", "", "as optics.prescriptions lists it"},
             {"title", "", "for people"},
             {"source", "", "of the numbers"},
             {"parameters", "", "values in SI by name, as optical_system:with takes them"}}},
           "name, title, source and parameters",
           system_info,
           "eye:info()"},
          {"prescription",
           {},
           prescription_fields,
           "the system as optics.system takes it",
           prescription,
           "eye:prescription()"},
          {"with",
           {{.name = "values",
             .type = Type::table,
             .help = "SI, by names of parameters; accommodation: in 1/m, 0 to 10 (0)"}},
           "optical_system",
           "a personal eye: the same with some parameters replaced, or as it accommodates",
           with,
           "eye:with { [\"cornea.anterior.radius\"] = 7.8 * mm, accommodation = 4 }"}};
}

}  // namespace vitreo::lua
