// Bindings of run: results, plots, tables; and format_quantity.
// SPDX-License-Identifier: Apache-2.0
#include "host/config/config.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/run/bind_picture.h"
#include "host/lua/run/classes.h"
#include "host/text/units.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace vitreo::lua {
namespace {

/// Throws std::invalid_argument with what was perhaps meant.
Unit known_unit(const std::string& symbol) {
  if (const auto unit = find_unit(symbol)) return *unit;
  std::vector<std::string> symbols;
  for (const Unit& unit : units()) symbols.emplace_back(unit.symbol);
  const std::string near = nearest(symbol, symbols);
  throw std::invalid_argument("unit: " + symbol + " is not a unit" +
                              (near.empty() ? "" : "; did you mean " + near + "?"));
}

/// What a value is shown in: its dimension, so that its size chooses the display unit; "%" stays,
/// since a ratio has no dimension that would say that it is meant in percent.
std::string shown_unit(const std::string& symbol) {
  const Unit unit = known_unit(symbol);
  return std::string(unit.dimension.empty() ? unit.symbol : unit.dimension);
}

/// The last one counts: what came out may overtake what was hoped for.
int headline(Call& call) {
  Session& session = session_of(call.L);
  // As an event: those that were overtaken stay in the record, each with its time.
  session.recorder.event(session.clock.now(), "headline", call.text(0));
  return 0;
}

/// At the prompt the name is noted too: of all results of the session only those of the protocol
/// that has just run are shown (end_nested in host/lua/prompt/prompt.cpp).
int result(Call& call) {
  const std::string unit = shown_unit(call.has(2) ? call.text(2) : "");
  session_of(call.L).recorder.result({call.text(0), call.number(1), unit});
  if (lua_getfield(call.L, LUA_REGISTRYINDEX, kStatedResults) == LUA_TTABLE) {
    lua_pushboolean(call.L, 1);
    lua_setfield(call.L, -2, call.text(0).c_str());
  }
  lua_pop(call.L, 1);
  return 0;
}

/// {"time", "s"} or {label = "time", unit = "s"}.
Axis axis_of(lua_State* L, int index, const std::string& name) {
  refuse_unknown(L, index, name + ".", {"label", "unit", "log"});
  Axis axis{text_field(L, index, "label", name + ".", false),
            text_field(L, index, "unit", name + ".", false)};
  for (int i = 1; i <= 2; ++i) {
    if (lua_rawgeti(L, index, i) == LUA_TSTRING)
      (i == 1 ? axis.label : axis.unit) = lua_tostring(L, -1);
    lua_pop(L, 1);
  }
  // A unit that is not known is refused here: after the run, in the report, it would be too late.
  known_unit(axis.unit);
  lua_getfield(L, index, "log");
  axis.logarithmic = lua_toboolean(L, -1) != 0;
  lua_pop(L, 1);
  return axis;
}

/// A number of a table; `otherwise` where there is none.
double number_field(lua_State* L, int index, const char* name, const std::string& where,
                    double otherwise) {
  lua_getfield(L, index, name);
  const bool none = lua_isnil(L, -1);
  if (!none && lua_type(L, -1) != LUA_TNUMBER)
    throw std::invalid_argument(where + name + ": wants a number, got " + kind_of(L, -1));
  const double value = none ? otherwise : lua_tonumber(L, -1);
  lua_pop(L, 1);
  return value;
}

std::vector<double> values_field(lua_State* L, int index, const char* name,
                                 const std::string& where) {
  lua_getfield(L, index, name);
  const auto values = to_numbers(L, -1);
  if (!values)
    throw std::invalid_argument(where + name + ": wants a list of numbers, got " + kind_of(L, -1));
  lua_pop(L, 1);
  return *values;
}

Mark mark_of(const std::string& name, const std::string& where) {
  if (name.empty() || name == "line") return Mark::line;
  if (name == "dashed") return Mark::dashed;
  if (name == "points") return Mark::points;
  throw std::invalid_argument(where + "mark: wants line, dashed or points, got " + name);
}

/// `where`: "series 2: ", with which every error begins. Lists of unequal lengths are refused here,
/// where the script's line is known.
Series series_of(lua_State* L, int index, const std::string& where) {
  if (!lua_istable(L, index))
    throw std::invalid_argument(where + " wants a table, got " + kind_of(L, index));
  refuse_unknown(L, index, where, {"label", "x", "y", "mark", "spread"});
  Series series{text_field(L, index, "label", where, false), values_field(L, index, "x", where),
                values_field(L, index, "y", where),
                mark_of(text_field(L, index, "mark", where, false), where)};
  if (series.x.size() != series.y.size())
    throw std::invalid_argument(where + "x has " + std::to_string(series.x.size()) +
                                " numbers, y has " + std::to_string(series.y.size()));
  if (lua_getfield(L, index, "spread") != LUA_TNIL)
    series.spread = values_field(L, index, "spread", where);
  lua_pop(L, 1);
  // A point without its bar among others that have one would look as if it were exact.
  if (!series.spread.empty() && series.spread.size() != series.x.size())
    throw std::invalid_argument(where + "spread has " + std::to_string(series.spread.size()) +
                                " numbers, x has " + std::to_string(series.x.size()));
  return series;
}

/// {label =, at =} or {label =, low =, high =}, an end that is left out being the plot's.
Expected expected_of(lua_State* L, int index, const std::string& where) {
  // Infinity is an end that is left out: a finite one would show as an edge on a longer axis.
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  if (!lua_istable(L, index))
    throw std::invalid_argument(where + " wants a table, got " + kind_of(L, index));
  refuse_unknown(L, index, where, {"label", "at", "low", "high"});
  const double at = number_field(L, index, "at", where, std::numeric_limits<double>::quiet_NaN());
  Expected expected{text_field(L, index, "label", where, false),
                    number_field(L, index, "low", where, -kInfinity),
                    number_field(L, index, "high", where, kInfinity)};
  if (!std::isnan(at)) expected.low = expected.high = at;
  // In this form it refuses NaN too, which is not at most anything.
  if (!(expected.low <= expected.high) || (std::isinf(expected.low) && std::isinf(expected.high)))
    throw std::invalid_argument(where + " wants at, or low or high, low at most high");
  return expected;
}

Annotation annotation_of(lua_State* L, int index, const std::string& where) {
  if (!lua_istable(L, index))
    throw std::invalid_argument(where + " wants a table, got " + kind_of(L, index));
  refuse_unknown(L, index, where, {"text", "x", "y"});
  // NaN is a coordinate that was not given: y may be missing, which makes it a dotted line.
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  Annotation annotation{text_field(L, index, "text", where, false),
                        number_field(L, index, "x", where, kNone),
                        number_field(L, index, "y", where, kNone)};
  if (!std::isfinite(annotation.x)) throw std::invalid_argument(where + "x: wants a number");
  return annotation;
}

/// Each item of the option's list, if it is given, by `read`.
template <typename Item>
std::vector<Item> list_option(Call& call, const char* name,
                              Item (*read)(lua_State*, int, const std::string&)) {
  std::vector<Item> items;
  call.push_option(name);
  const int list = lua_gettop(call.L);
  if (lua_istable(call.L, list))
    for (lua_Integer i = 1; i <= static_cast<lua_Integer>(lua_rawlen(call.L, list)); ++i) {
      lua_rawgeti(call.L, list, i);
      items.push_back(
          read(call.L, lua_gettop(call.L), std::string(name) + " " + std::to_string(i) + ": "));
      lua_pop(call.L, 1);
    }
  lua_settop(call.L, list - 1);
  return items;
}

Axis axis_option(Call& call, const char* name) {
  call.push_option(name);
  const Axis axis = axis_of(call.L, lua_gettop(call.L), name);
  lua_pop(call.L, 1);
  return axis;
}

int plot(Call& call) {
  Plot plot;
  plot.title = *call.text_option("title");
  plot.x = axis_option(call, "x");
  plot.y = axis_option(call, "y");
  plot.equal_aspect = call.flag_option("equal_aspect");
  plot.note = call.text_option("note").value_or("");
  plot.series = list_option(call, "series", series_of);
  plot.expected = list_option(call, "expected", expected_of);
  plot.annotations = list_option(call, "marks", annotation_of);
  session_of(call.L).recorder.plot(plot);
  return 0;
}

/// One row of a table: texts as they are, numbers as Lua shows them.
std::vector<std::string> cells_of(lua_State* L, int index, const std::string& where) {
  if (!lua_istable(L, index))
    throw std::invalid_argument(where + ": wants a list of texts, got " + kind_of(L, index));
  std::vector<std::string> cells;
  for (lua_Integer i = 1; i <= static_cast<lua_Integer>(lua_rawlen(L, index)); ++i) {
    lua_rawgeti(L, index, i);
    cells.push_back(plain_text(L, lua_gettop(L)));
    lua_pop(L, 1);
  }
  return cells;
}

int table(Call& call) {
  Table table;
  table.title = *call.text_option("title");
  call.push_option("header");
  table.header = cells_of(call.L, lua_gettop(call.L), "header");
  call.push_option("rows");
  const int rows = lua_gettop(call.L);
  for (lua_Integer i = 1; i <= static_cast<lua_Integer>(lua_rawlen(call.L, rows)); ++i) {
    lua_rawgeti(call.L, rows, i);
    table.rows.push_back(cells_of(call.L, lua_gettop(call.L), "row " + std::to_string(i)));
    // In a row that is too short every later cell would stand below another column's head.
    if (table.rows.back().size() != table.header.size())
      throw std::invalid_argument("row " + std::to_string(i) + ": has " +
                                  std::to_string(table.rows.back().size()) +
                                  " cells, the header has " + std::to_string(table.header.size()));
    lua_pop(call.L, 1);
  }
  session_of(call.L).recorder.table(table);
  return 0;
}

int format_quantity(Call& call) {
  const int digits = call.has(2) ? static_cast<int>(call.number(2)) : 3;
  return call.result(
      vitreo::format_quantity(call.number(0), shown_unit(call.has(1) ? call.text(1) : ""), digits));
}

Argument plot_options() {
  const auto field = [](const char* name, Type type, const char* help, bool optional = false) {
    return Argument{.name = name, .type = type, .optional = optional, .help = help};
  };
  return {
      .name = "options",
      .type = Type::options,
      .options = {
          field("title", Type::text, ""),
          field("x", Type::table, "{\"time\", \"s\"}; log = true: decades"),
          field("y", Type::table, "{\"error\", \"um\"}"),
          field(
              "series", Type::list,
              "{{label =, x = {...}, y = {...}, mark = \"line\", \"dashed\" or \"points\", spread "
              "= {...} half-lengths of bars}, ...}"),
          field("expected", Type::list,
                "{{label =, at =} or {label =, low =, high =}, ...}: lines and bands of y", true),
          field("marks", Type::list,
                "{{text =, x =, y =}, ...}: words at points, or, without y, at dotted lines", true),
          field("equal_aspect", Type::flag, "a millimeter is as long in both directions", true),
          field("note", Type::text, "one line below", true)}};
}

}  // namespace

std::vector<Binding> run_result_rows() {
  const auto text = [](const char* name, bool optional = false, const char* help = "") {
    return Argument{.name = name, .type = Type::text, .optional = optional, .help = help};
  };
  const auto table_of = [](const char* name, Type type, const char* help) {
    return Argument{.name = name, .type = type, .help = help};
  };
  const Argument title = text("title");
  return {
      {"result",
       {text("name"),
        {.name = "value", .type = Type::number, .help = "SI"},
        text("unit", true, "what it measures, such as \"m\"; of \"%\" the value is the ratio")},
       "",
       "states a key result",
       result,
       "run:result(\"wobble\", 12 * um, \"m\")"},
      {"headline",
       {text("sentence")},
       "",
       "says in one sentence what came out: the report's first line",
       headline,
       "run:headline(\"Square followed to \" .. format_quantity(137 * um, \"m\") .. \" rms\")"},
      {"plot",
       {plot_options()},
       "",
       "puts a plot into the report; values in SI",
       plot,
       "run:plot { title = \"drift\", x = { \"time\", \"s\" }, y = { \"x\", \"um\" }, series = { { "
       "label = \"x\", x = { 0, 1 }, y = { 0, 1e-6 } } } }"},
      picture_row(),
      judge_row(),
      {"table",
       {{.name = "options",
         .type = Type::options,
         .options = {title, table_of("header", Type::list, "texts"),
                     table_of("rows", Type::list, "lists of texts")}}},
       "",
       "puts a table into the report",
       table,
       "run:table { title = \"drift\", header = { \"place\", \"µm/s\" }, rows = { { \"A\", \"1.2\" "
       "} } }"}};
}

Binding format_quantity_row() {
  return {"format_quantity",
          {{.name = "value", .type = Type::number, .help = "SI"},
           {.name = "unit",
            .type = Type::text,
            .optional = true,
            .help = "what it measures, such as \"m\"; of \"%\" the value is the ratio"},
           {.name = "digits",
            .type = Type::integer,
            .optional = true,
            .min = 1,
            .max = 17,
            .help = "significant ones (3)"}},
          "string",
          "a number in the unit that people would choose: \"500 µm\"",
          format_quantity,
          "format_quantity(0.5 * mm, \"m\")"};
}

}  // namespace vitreo::lua
