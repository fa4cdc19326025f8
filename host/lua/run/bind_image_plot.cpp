// SPDX-License-Identifier: Apache-2.0
#include "host/lua/run/bind_image_plot.h"

#include "host/config/config.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/vision/bind_vision.h"
#include "host/plot/image_plot.h"

#include <stdexcept>

namespace vitreo::lua {
namespace {

/// {{u, v}, ...} at the top of the stack, appended.
void read_points(lua_State* L, const std::string& where, Series& series) {
  const int list = lua_gettop(L);
  if (!lua_istable(L, list))
    throw std::invalid_argument(where + ": wants a list of {u, v}, got " + kind_of(L, list));
  for (lua_Integer i = 1; i <= static_cast<lua_Integer>(lua_rawlen(L, list)); ++i) {
    lua_rawgeti(L, list, i);
    const auto point = to_numbers(L, -1);
    if (!point || point->size() != 2)
      throw std::invalid_argument(where + ": entry " + std::to_string(i) + ": wants {u, v} in px");
    series.x.push_back((*point)[0]);
    series.y.push_back((*point)[1]);
    lua_settop(L, list);
  }
}

Series mark_at(lua_State* L, int index, const std::string& where) {
  if (!lua_istable(L, index))
    throw std::invalid_argument(where + ": wants a table, got " + kind_of(L, index));
  refuse_unknown(L, index, where + ".", {"label", "line", "points", "ellipse", "dashed"});
  Series series{text_field(L, index, "label", where + ".", false), {}, {}, Mark::line};
  lua_getfield(L, index, "dashed");
  if (!lua_isnil(L, -1) && !lua_isboolean(L, -1))
    throw std::invalid_argument(where + ".dashed: wants true or false, got " +
                                kind_of(L, lua_gettop(L)));
  if (lua_toboolean(L, -1) != 0) series.mark = Mark::dashed;
  lua_pop(L, 1);
  int shapes = 0;
  for (const char* const shape : {"line", "points", "ellipse"}) {
    if (lua_getfield(L, index, shape) != LUA_TNIL) {
      ++shapes;
      const std::string name = where + "." + shape;
      if (std::string_view(shape) == "ellipse") {
        if (!lua_istable(L, -1))
          throw std::invalid_argument(name + ": wants a table, got " + kind_of(L, lua_gettop(L)));
        series = outline(series.label, ellipse_at(L, lua_gettop(L), name), series.mark);
      } else {
        read_points(L, name, series);
      }
      if (std::string_view(shape) == "points") series.mark = Mark::points;
    }
    lua_pop(L, 1);
  }
  if (shapes != 1) throw std::invalid_argument(where + ": wants one of line, points and ellipse");
  return series;
}

int image_plot(Call& call) {
  lua_State* const L = call.L;
  ImagePlot plot;
  plot.title = *call.text_option("title");
  call.push_option("image");
  plot.image = static_cast<const Image*>(handle_object(L, lua_gettop(L)))->pixels;
  lua_pop(L, 1);
  plot.note = call.text_option("note").value_or("");
  plot.scale_bar_px = call.number_option("scale_bar_px").value_or(0);
  plot.scale_bar_label = call.text_option("scale_bar_label").value_or("");
  if ((plot.scale_bar_px > 0) == plot.scale_bar_label.empty())
    throw std::invalid_argument(
        "scale_bar_label: wants to be given with scale_bar_px, and the other way round");
  if (call.push_option("marks")) {
    const int list = lua_gettop(L);
    for (lua_Integer i = 1; i <= static_cast<lua_Integer>(lua_rawlen(L, list)); ++i) {
      lua_rawgeti(L, list, i);
      plot.marks.push_back(mark_at(L, lua_gettop(L), "mark " + std::to_string(i)));
      lua_settop(L, list);
    }
  }
  lua_pop(L, 1);
  session_of(L).recorder.drawing(plot.title, to_svg(plot));
  return 0;
}

}  // namespace

Binding image_plot_row() {
  const auto field = [](const char* name, Type type, bool optional, const char* help) {
    return Argument{.name = name, .type = type, .optional = optional, .help = help};
  };
  return {
      "image_plot",
      {{.name = "options",
        .type = Type::options,
        .options =
            {field("title", Type::text, false, ""),
             {.name = "image", .type = Type::handle, .handle = "image"},
             field("marks", Type::list, true,
                   "{{label =, line = {{u, v}, ...}, or points =, or ellipse = a track or {x_px =, "
                   "...}, "
                   "dashed = true}, ...}, px"),
             {.name = "scale_bar_px", .type = Type::number, .optional = true, .min = 1, .max = 1e5},
             field("scale_bar_label", Type::text, true, "such as \"1 mm\""),
             field("note", Type::text, true, "one line below")}}},
      "",
      "puts an image with lines, points and ellipses over it into the report; also to be had as "
      "SVG or PNG",
      image_plot,
      "run:image_plot { title = \"seen\", image = image, marks = { { label = \"robot\", "
      "ellipse = track } } }"};
}

}  // namespace vitreo::lua
