// SPDX-License-Identifier: Apache-2.0
#include "host/lua/run/bind_picture.h"

#include "host/config/config.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/tables.h"
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

/// One entry of `marks`. Exactly one shape: of two it would be open which one the label names.
/// Throws std::invalid_argument that begins with `where`.
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

std::vector<Series> marks_option(const Call& call) {
  std::vector<Series> marks;
  if (call.push_option("marks")) {
    const int list = lua_gettop(call.L);
    for (lua_Integer i = 1; i <= static_cast<lua_Integer>(lua_rawlen(call.L, list)); ++i) {
      lua_rawgeti(call.L, list, i);
      marks.push_back(mark_at(call.L, lua_gettop(call.L), "mark " + std::to_string(i)));
      lua_settop(call.L, list);
    }
  }
  lua_pop(call.L, 1);
  return marks;
}

/// Whether it is given, false among them.
bool has_option(const Call& call, const char* name) {
  const bool given = call.push_option(name);
  lua_pop(call.L, 1);
  return given;
}

/// A drawing is whole as it is: nothing can be put over it or below it.
int drawing(const Call& call) {
  for (const char* const of_image : {"image", "marks", "scale_bar_px", "scale_bar_label", "note"})
    if (has_option(call, of_image))
      throw std::invalid_argument(std::string(of_image) + ": does not go with svg");
  session_of(call.L).recorder.drawing(*call.text_option("title"), *call.text_option("svg"));
  return 0;
}

/// The image alone is kept without loss, as PNG; under an overlay as the JPEG of a drawing, which
/// is there to be looked at.
int picture(Call& call) {
  if (has_option(call, "svg")) return drawing(call);
  if (!has_option(call, "image"))
    throw std::invalid_argument("image: is missing; wants it, or svg");
  ImagePlot plot;
  plot.title = *call.text_option("title");
  plot.image = call.handle_option<Image>("image").pixels;
  plot.note = call.text_option("note").value_or("");
  plot.scale_bar_px = call.number_option("scale_bar_px").value_or(0);
  plot.scale_bar_label = call.text_option("scale_bar_label").value_or("");
  if ((plot.scale_bar_px > 0) == plot.scale_bar_label.empty())
    throw std::invalid_argument(
        "scale_bar_label: wants to be given with scale_bar_px, and the other way round");
  plot.marks = marks_option(call);
  Recorder& recorder = session_of(call.L).recorder;
  if (plot.marks.empty() && plot.scale_bar_px == 0)
    recorder.picture(plot.title, plot.note, plot.image);
  else
    recorder.drawing(plot.title, to_svg(plot));
  return 0;
}

}  // namespace

Binding picture_row() {
  const auto text = [](const char* name, bool optional, const char* help) {
    return Argument{.name = name, .type = Type::text, .optional = optional, .help = help};
  };
  return {"picture",
          {options_of(
              {text("title", false, ""),
               {.name = "image", .type = Type::handle, .optional = true, .handle = "image"},
               text("svg", true,
                    "a whole SVG document in place of the image, such as optical_system:layout "
                    "makes"),
               {.name = "marks",
                .type = Type::list,
                .optional = true,
                .help = "over the image: {{label =, line = {{u, v}, ...}, or points =, or ellipse "
                        "= a track or {x_px =, ...}, dashed = true}, ...}, px"},
               {.name = "scale_bar_px",
                .type = Type::number,
                .optional = true,
                .min = 1,
                .max = 1e5,
                .help = "its length in the image"},
               text("scale_bar_label", true, "such as \"1 mm\""),
               text("note", true, "one line below the image")})},
          "",
          "puts an image, with lines, points and ellipses over it, or a drawing into the report; "
          "also to be had as a file",
          picture,
          "run:picture { title = \"seen\", image = image, marks = { { label = \"robot\", "
          "ellipse = track } } }"};
}

}  // namespace vitreo::lua
