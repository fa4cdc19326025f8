// optical_system: its parameters, personal eyes made of them, and the system as a table of rows.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/values.h"
#include "host/lua/optics/bind_optics.h"
#include "optics/system/prescription_rows.h"

#include <cmath>
#include <stdexcept>

namespace vitreo::lua {
namespace {

using optics::PrescriptionRow;

constexpr std::pair<const char*, double PrescriptionRow::*> kColumns[] = {
    {"radius", &PrescriptionRow::radius},
    {"conic", &PrescriptionRow::conic},
    {"thickness", &PrescriptionRow::thickness},
    {"index", &PrescriptionRow::index},
    {"semi_diameter", &PrescriptionRow::semi_diameter}};
constexpr const char* kAspheric[] = {"a4", "a6", "a8", "a10"};

void set_text(lua_State* L, const char* name, const std::string& text) {
  lua_pushlstring(L, text.data(), text.size());
  lua_setfield(L, -2, name);
}

/// What is as usual is left out, so that a table reads as the thesis' does.
void push_row(lua_State* L, const PrescriptionRow& row) {
  const PrescriptionRow usual;
  lua_newtable(L);
  set_text(L, "surface", row.surface);
  set_text(L, "medium", row.medium);
  for (const auto& [name, column] : kColumns)
    if (row.*column != usual.*column) set_number(L, name, row.*column);
  for (std::size_t i = 0; i < 4; ++i)
    if (row.aspheric[i] != 0) set_number(L, kAspheric[i], row.aspheric[i]);
}

double number_field(lua_State* L, int index, const char* name, double usual,
                    const std::string& where) {
  const int type = lua_getfield(L, index, name);
  if (type != LUA_TNIL && type != LUA_TNUMBER)
    throw std::invalid_argument(where + name + ": wants a number, got " + kind_of(L, -1));
  const double value = type == LUA_TNIL ? usual : lua_tonumber(L, -1);
  lua_pop(L, 1);
  return value;
}

PrescriptionRow row_at(lua_State* L, int index, const std::string& where) {
  if (!lua_istable(L, index))
    throw std::invalid_argument(where + "wants a table, got " + kind_of(L, index));
  std::vector<std::string> known{"surface", "medium"};
  for (const auto& [name, column] : kColumns) known.emplace_back(name);
  for (const char* name : kAspheric) known.emplace_back(name);
  refuse_unknown(L, index, where, known);
  PrescriptionRow row;
  row.surface = text_field(L, index, "surface", where, false);
  row.medium = text_field(L, index, "medium", where, false);
  for (const auto& [name, column] : kColumns)
    row.*column = number_field(L, index, name, row.*column, where);
  for (std::size_t i = 0; i < 4; ++i)
    row.aspheric[i] = number_field(L, index, kAspheric[i], 0, where);
  return row;
}

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

int name(Call& call) { return call.result(eye_of(call).name); }
int title(Call& call) { return call.result(eye_of(call).title); }

int parameters(Call& call) {
  lua_newtable(call.L);
  lua_Integer count = 0;
  for (const optics::Parameter& parameter : optics::parameters(eye_of(call))) {
    lua_newtable(call.L);
    set_text(call.L, "name", parameter.name);
    set_text(call.L, "unit", parameter.unit);
    set_number(call.L, "value", parameter.value);  // an infinite radius is a plane
    lua_rawseti(call.L, -2, ++count);
  }
  return 1;
}

int parameter(Call& call) { return call.result(optics::parameter(eye_of(call), call.text(0))); }

int with(Call& call) {
  const int table = call.index(0);
  std::vector<optics::Override> overrides;
  for (const std::string& key : text_keys(call.L, table)) {
    if (lua_getfield(call.L, table, key.c_str()) != LUA_TNUMBER)
      throw std::invalid_argument(key + ": wants a number, got " + kind_of(call.L, -1));
    overrides.emplace_back(key, lua_tonumber(call.L, -1));
    lua_pop(call.L, 1);
  }
  push_system(call.L, optics::with_parameters(eye_of(call), overrides));
  return 1;
}

int accommodated(Call& call) {
  push_system(call.L, optics::accommodate(eye_of(call), call.number(0)));
  return 1;
}

int rows(Call& call) {
  push_prescription_table(call.L, eye_of(call));
  return 1;
}

}  // namespace

void push_prescription_table(lua_State* L, const optics::Prescription& prescription) {
  const optics::PrescriptionTable table = optics::to_rows(prescription);
  lua_newtable(L);
  set_text(L, "name", table.name);
  set_text(L, "title", table.title);
  set_text(L, "source", table.source);
  if (table.stop_surface > 0) {
    lua_newtable(L);
    lua_pushinteger(L, table.stop_surface);
    lua_setfield(L, -2, "surface");
    set_number(L, "radius", table.stop_radius);
    lua_setfield(L, -2, "stop");
  }
  lua_newtable(L);
  for (std::size_t i = 0; i < table.rows.size(); ++i) {
    push_row(L, table.rows[i]);
    lua_rawseti(L, -2, static_cast<lua_Integer>(i + 1));
  }
  lua_setfield(L, -2, "rows");
}

optics::Prescription prescription_table_at(lua_State* L, int index) {
  refuse_unknown(L, index, "", {"name", "title", "source", "stop", "rows"});
  optics::PrescriptionTable table;
  table.name = text_field(L, index, "name", "", false);
  table.title = text_field(L, index, "title", "", false);
  table.source = text_field(L, index, "source", "", false);
  read_stop(L, index, table);
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
  return {
      {"name", {}, "string", "as optics.prescriptions lists it", name},
      {"title", {}, "string", "for people", title},
      {"parameters",
       {},
       "list of tables",
       "name, unit, value of every parameter, in SI",
       parameters},
      {"parameter",
       {{.name = "name", .type = Type::text, .help = "such as \"lens.index\""}},
       "number",
       "one of them",
       parameter},
      {"with",
       {{.name = "values", .type = Type::table, .help = "{[\"cornea.anterior.radius\"] = 7.8*mm}"}},
       "optical_system",
       "a personal eye: the same with some parameters replaced",
       with},
      {"accommodated",
       {{.name = "accommodation",
         .type = Type::number,
         .unit = "1/m",
         .min = 0,
         .max = 10,
         .help = "dioptres"}},
       "optical_system",
       "the eye when it accommodates",
       accommodated},
      {"rows",
       {},
       "table",
       "the system as optics.system takes it: name, title, source, stop, rows",
       rows}};
}

}  // namespace vitreo::lua
