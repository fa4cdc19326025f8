// SPDX-License-Identifier: Apache-2.0
#include "host/lua/prompt/prompt_see.h"

#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/state.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/run/classes.h"
#include "host/lua/vision/bind_vision.h"
#include "host/terminal/terminal_picture.h"
#include "host/text/units.h"

#include <ostream>
#include <stdexcept>
#include <string>
#include <unistd.h>

namespace vitreo::lua {
namespace {

// In the registry, which scripts do not see: a global of theirs could hide the screen.
constexpr const char* kScreen = "vitreo.prompt.screen";

struct PromptScreen {
  std::ostream* out = nullptr;
  bool interactive = false;
};

/// Throws std::runtime_error outside of a prompt, where the rows do not exist either: a script that
/// was written for the prompt is told, not crashed.
PromptScreen screen_at(lua_State* L) {
  PromptScreen screen;
  if (lua_getfield(L, LUA_REGISTRYINDEX, kScreen) == LUA_TUSERDATA)
    screen = *static_cast<const PromptScreen*>(lua_touserdata(L, -1));
  lua_pop(L, 1);
  if (screen.out == nullptr) throw std::runtime_error("there is nothing to draw on here");
  return screen;
}

/// Asked anew each time: a window is made larger and smaller.
Screen size_of(const PromptScreen& screen) {
  return screen.interactive ? screen_of(STDOUT_FILENO) : Screen{};
}

// Past print(), whose listener writes out control characters: a script's words may not steer the
// screen, the program's own pictures must.
int show_image(Call& call) {
  const PromptScreen screen = screen_at(call.L);
  *screen.out << picture_text(call.handle<Image>(0).pixels, size_of(screen)) << std::flush;
  return 0;
}

/// {"time", "s"} or a text.
Axis axis_named(lua_State* L, int index, const char* name) {
  if (lua_isnil(L, index)) return {};
  if (lua_type(L, index) == LUA_TSTRING) return {plain_text(L, index), ""};
  if (!lua_istable(L, index))
    throw std::invalid_argument(std::string(name) + ": wants a name, or {name, unit}");
  Axis axis;
  for (int i = 1; i <= 2; ++i) {
    if (lua_rawgeti(L, index, i) == LUA_TSTRING)
      (i == 1 ? axis.label : axis.unit) = plain_text(L, lua_gettop(L));
    lua_pop(L, 1);
  }
  return axis;
}

/// One list of numbers, or several.
std::vector<std::vector<double>> lists_at(lua_State* L, int index) {
  if (const auto one = to_numbers(L, index)) return {*one};
  std::vector<std::vector<double>> lists;
  if (!lua_istable(L, index))
    throw std::invalid_argument("y: wants a list of numbers, or several, got " + kind_of(L, index));
  // A list that is wrong is told by its number, counted from 1 as Lua counts.
  for (lua_Integer i = 1; i <= static_cast<lua_Integer>(lua_rawlen(L, index)); ++i) {
    lua_rawgeti(L, index, i);
    const auto list = to_numbers(L, lua_gettop(L));
    if (!list)
      throw std::invalid_argument("y: " + std::to_string(i) + ": wants a list of numbers, got " +
                                  kind_of(L, -1));
    lists.push_back(*list);
    lua_pop(L, 1);
  }
  return lists;
}

/// Values stay SI; the axis divides by its unit's factor when it is drawn.
void take_plot_options(const Call& call, Plot& plot) {
  lua_State* const L = call.L;
  plot.title = call.text_option("title").value_or("");
  for (const char* const name : {"x", "y"}) {
    call.push_option(name);
    (name[0] == 'x' ? plot.x : plot.y) = axis_named(L, lua_gettop(L), name);
    lua_pop(L, 1);
  }
  // Labels beyond the last series are passed over; a series without one is not in the legend.
  call.push_option("labels");
  const int labels = lua_gettop(L);
  for (std::size_t i = 0; lua_istable(L, labels) && i < plot.series.size(); ++i) {
    lua_rawgeti(L, labels, static_cast<lua_Integer>(i + 1));
    if (lua_type(L, -1) == LUA_TSTRING) plot.series[i].label = plain_text(L, lua_gettop(L));
    lua_pop(L, 1);
  }
  lua_pop(L, 1);
  // The first is what was measured: its points; what follows is laid through them.
  const std::string mark =
      call.text_option("mark").value_or(plot.series.size() > 1 ? "points" : "line");
  if (mark != "points" && mark != "line")
    throw std::invalid_argument("mark: wants points or line, got " + mark);
  if (!plot.series.empty() && mark == "points") plot.series[0].mark = Mark::points;
}

// As the report's plots are laid out: a value that is none breaks a line.
int draw_plot(Call& call) {
  const PromptScreen screen = screen_at(call.L);
  Plot plot;
  const std::vector<double> x = call.numbers(0);
  for (std::vector<double>& y : lists_at(call.L, call.index(1))) {
    // Refused before anything is drawn: points would be missing, and it would not show.
    if (y.size() != x.size())
      throw std::invalid_argument("y has " + std::to_string(y.size()) + " numbers, x has " +
                                  std::to_string(x.size()));
    plot.series.push_back({"", x, std::move(y), Mark::line});
  }
  // Without options the rule is the one that take_plot_options() has where no mark is given.
  if (call.has(2))
    take_plot_options(call, plot);
  else if (plot.series.size() > 1)
    plot.series[0].mark = Mark::points;
  *screen.out << plot_text(plot, size_of(screen)) << std::flush;
  return 0;
}

/// A protocol as run() runs it, and meanwhile each row that it records as a line of a table; at the
/// end a plot of each stream's first channel.
/// In Lua, since it stands in the place of a method for as long as the protocol runs: the method
/// comes back by <close>, whatever ends the run, a stop included.
constexpr const char* kFollow = R"(
local methods, run, say, plot, format_quantity = ...
local function names_of(values)
  local names = {}
  for name, value in pairs(values) do
    if type(value) == "number" then names[#names + 1] = name end
  end
  table.sort(names)
  return names
end
local function cell(text, width) return (" "):rep(width - utf8.len(text)) .. text end
return function(protocol, parameters)
  local record, streams, order = methods.record, {}, {}
  local function told(stream, values, units)
    local seen = streams[stream]
    if not seen then
      seen = { names = names_of(values), rows = {}, units = units or {} }
      streams[stream], order[#order + 1] = seen, stream
      local head = { cell(stream, 14) }
      for i, name in ipairs(seen.names) do
        head[i + 1] = cell(name, math.max(12, utf8.len(name)))
      end
      say(table.concat(head, "  "))
    end
    seen.rows[#seen.rows + 1] = values
    local line = { cell(tostring(#seen.rows), 14) }
    for i, name in ipairs(seen.names) do
      local value = values[name]
      local known = type(value) == "number"
      local text = known and format_quantity(value, seen.units[name] or "") or "–"
      line[i + 1] = cell(text, math.max(12, utf8.len(name)))
    end
    say(table.concat(line, "  "))
  end
  local back <close> = setmetatable({}, { __close = function()
    methods.record = record
    for _, stream in ipairs(order) do
      local seen, x, y = streams[stream], {}, {}
      local name = seen.names[1]
      for i, values in ipairs(seen.rows) do
        if name and type(values[name]) == "number" then x[#x + 1], y[#y + 1] = i, values[name] end
      end
      if #x > 2 then
        local largest = 0
        for _, value in ipairs(y) do largest = math.max(largest, math.abs(value)) end
        local unit = seen.units[name] or ""
        local shown = format_quantity(largest, unit):match("%s(%S+)$")
        local axis = { name, shown or unit }
        plot(x, y, { title = stream, x = "row", y = axis, mark = "points" })
      end
    end
  end })
  methods.record = function(self, stream, values, units, ...)
    record(self, stream, values, units, ...)
    told(stream, values, units)
  end
  run(protocol, parameters)
end)";

}  // namespace

// A userdata and no light one: it is the state's, and goes with it. The stream outlives the state.
void set_prompt_screen(lua_State* L, std::ostream& out, bool interactive) {
  // A pointer and a flag: Lua frees their bytes, and no destructor is needed.
  auto* const screen = static_cast<PromptScreen*>(lua_newuserdatauv(L, sizeof(PromptScreen), 0));
  *screen = {&out, interactive};
  lua_setfield(L, LUA_REGISTRYINDEX, kScreen);
}

std::vector<Binding> prompt_see_functions() {
  return {
      {"show",
       {{.name = "image",
         .type = Type::handle,
         .help = "of a frame, a file, a mosaic",
         .handle = "image"}},
       "",
       "at the prompt: shows an image in the terminal, by its own graphics, in blocks or in dots",
       show_image,
       "show(rig.top_camera:grab().image)"},
      {"plot",
       {{.name = "x", .type = Type::numbers},
        {.name = "y", .type = Type::list, .help = "a number for each x, or several such lists"},
        options_of({{.name = "title", .type = Type::text, .optional = true},
                    {.name = "x", .optional = true, .help = "the axis: a name, or {name, unit}"},
                    {.name = "y", .optional = true, .help = "the axis: a name, or {name, unit}"},
                    {.name = "labels",
                     .type = Type::list,
                     .optional = true,
                     .help = "a name for each list"},
                    {.name = "mark",
                     .type = Type::text,
                     .optional = true,
                     .help = "of the first list, \"points\" or \"line\""}})},
       "",
       "at the prompt: a plot in the terminal; values in SI, the first of several lists as points",
       draw_plot,
       "plot({ 0, 1, 2 }, { 0, 1, 4 }, { y = { \"error\", \"um\" } })"}};
}

// The methods of `run` are a table that its __index has as an upvalue: a row recorded is seen by a
// function that stands in the place of run:record while a protocol is followed.
void open_follow(lua_State* L) {
  load_text(L, kFollow, "watch");
  luaL_getmetatable(L, run_class().name.c_str());
  lua_getfield(L, -1, "__index");
  // open_class() in interpreter/binding.cpp makes it so.
  // Upvalue 1 of __index are the methods. They take the metatable's place on the stack, as the
  // first argument; the others follow in the order of kFollow's first line.
  if (lua_getupvalue(L, -1, 1) == nullptr) throw std::logic_error("run has no methods");
  lua_replace(L, -3);
  lua_pop(L, 1);
  lua_getglobal(L, "run");
  lua_getglobal(L, "print");
  lua_getglobal(L, "plot");
  lua_getglobal(L, "format_quantity");
  lua_call(L, 5, 1);
  lua_setglobal(L, "follow");
}

}  // namespace vitreo::lua
