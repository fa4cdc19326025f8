// vision.focus and vision.autofocus: how sharp an image is, where that peaks, and where to go next
// to find out.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/tables.h"
#include "host/lua/vision/bind_vision.h"
#include "host/lua/vision/classes.h"
#include "vision/autofocus.h"
#include "vision/focus.h"

#include <opencv2/imgproc.hpp>

#include <string>

namespace vitreo::lua {
namespace {

cv::Mat gray_of(const cv::Mat& image) {
  if (image.channels() == 1) return image;
  cv::Mat gray;
  cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
  return gray;
}

int measures(Call& call) {
  lua_newtable(call.L);
  lua_Integer count = 0;
  for (const vision::FocusMeasure measure : vision::focus_measures()) {
    lua_pushstring(call.L, std::string(vision::name_of(measure)).c_str());
    lua_rawseti(call.L, -2, ++count);
  }
  return 1;
}

/// x, y, width, height in px: all of them or none.
cv::Rect window_option(const Call& call, const cv::Size& whole) {
  const auto x = call.number_option("x"), y = call.number_option("y");
  const auto width = call.number_option("width"), height = call.number_option("height");
  if (!x && !y && !width && !height) return {{0, 0}, whole};
  if (!x || !y || !width || !height)
    throw std::invalid_argument("x, y, width, height: the window wants all four");
  return {static_cast<int>(*x), static_cast<int>(*y), static_cast<int>(*width),
          static_cast<int>(*height)};
}

int measure(Call& call) {
  const cv::Mat gray = gray_of(call.handle<Image>(0).pixels);
  cv::Rect window({0, 0}, gray.size());
  vision::FocusMeasure how = vision::kDefaultFocusMeasure;
  if (call.has(1)) {
    window = window_option(call, gray.size());
    if (const auto name = call.text_option("measure")) how = vision::focus_measure(*name);
  }
  const vision::FocusReading reading = vision::focus(gray, window, how);
  lua_pushnumber(call.L, reading.value);
  push_fields(call.L, {{"mean", reading.mean},
                       {"saturated", reading.saturated},
                       {"pixels", static_cast<double>(reading.pixels)}});
  return 2;
}

void push_fit(lua_State* L, const vision::FocusPeakFit& fit) {
  lua_newtable(L);
  set_fields(L, {{"noise", fit.noise}});
  if (fit.peak)
    set_fields(
        L,
        {{"position", fit.peak->position}, {"sigma", fit.peak->sigma}, {"value", fit.peak->value}});
  lua_pushstring(L, std::string(vision::name_of(fit.answer)).c_str());
  lua_setfield(L, -2, "answer");
}

int peak(Call& call) {
  const std::vector<double> positions = call.numbers(0), values = call.numbers(1);
  if (positions.size() != values.size())
    throw std::invalid_argument("values: has " + std::to_string(values.size()) +
                                " numbers, positions has " + std::to_string(positions.size()));
  std::vector<vision::FocusSample> samples;
  for (std::size_t i = 0; i < positions.size(); ++i) samples.push_back({positions[i], values[i]});
  push_fit(call.L, vision::find_focus_peak(samples));
  return 1;
}

int make_autofocus(Call& call) {
  vision::AutofocusSettings settings;
  settings.low = *call.number_option("low");
  settings.high = *call.number_option("high");
  settings.step = *call.number_option("step");
  if (const auto name = call.text_option("strategy"))
    settings.strategy = vision::autofocus_strategy(*name);
  if (const auto coarse = call.number_option("coarse")) settings.coarse = static_cast<int>(*coarse);
  if (const auto repeats = call.number_option("repeats"))
    settings.repeats = static_cast<int>(*repeats);
  if (const auto backlash = call.number_option("backlash")) settings.backlash = *backlash;
  if (const auto hysteresis = call.number_option("hysteresis")) settings.hysteresis = *hysteresis;
  push_handle(call.L, autofocus_class(), std::make_shared<vision::Autofocus>(settings));
  return 1;
}

int start(Call& call) { return call.result(call.self<vision::Autofocus>().start()); }

int next(Call& call) {
  const vision::AutofocusStep step =
      call.self<vision::Autofocus>().next(call.number(0), call.number(1));
  if (const double* position = std::get_if<double>(&step)) return call.result(*position);
  const auto& done = std::get<vision::AutofocusResult>(step);
  lua_pushnil(call.L);
  push_fit(call.L, done.fit);
  set_fields(call.L, {{"readings", static_cast<double>(done.readings)}});
  if (done.park) set_fields(call.L, {{"park", *done.park}});
  return 2;
}

Argument needed(const char* name, const char* help) {
  return {.name = name, .type = Type::number, .help = help};
}

}  // namespace

std::vector<Binding> vision_focus_rows() {
  const auto whole = [](const char* name) {
    return number_option_row(name, -1e6, 1e6, "px", Type::integer);
  };
  const auto words = [](const char* name, const char* help, std::vector<std::string> choices) {
    return Argument{.name = name,
                    .type = Type::text,
                    .optional = true,
                    .help = help,
                    .choices = std::move(choices)};
  };
  std::vector<std::string> known_measures;
  for (const vision::FocusMeasure measure : vision::focus_measures())
    known_measures.emplace_back(vision::name_of(measure));
  const auto numbers = [](const char* name, const char* help) {
    return Argument{.name = name, .type = Type::numbers, .help = help};
  };
  return {
      {"vision.focus.measures", {}, "list of names", "the focus measures there are", measures},
      {"vision.focus.measure",
       {handle_row("image", "image", ""),
        {.name = "options",
         .type = Type::options,
         .optional = true,
         .options = {words("measure",
                           "smoothed_tenengrad as is; normalized_variance is the thesis'",
                           known_measures),
                     whole("x"), whole("y"), whole("width"), whole("height")}}},
       "number, {mean, saturated, pixels}",
       "how sharp an image is, or a window of it",
       measure},
      {"vision.focus.peak",
       {numbers("positions", "in any one unit"), numbers("values", "of a focus measure there")},
       "table",
       "answer (found, at low end, at high end, no peak), noise; position, sigma, value when found",
       peak},
      {"vision.autofocus",
       {{.name = "options",
         .type = Type::options,
         .options = {needed("low", "of the travel"), needed("high", "of the travel"),
                     needed("step", "the finest"),
                     words("strategy", "how the travel is searched (coarse_to_fine)",
                           {"coarse_to_fine", "sweep", "golden_section", "fibonacci"}),
                     number_option_row("coarse", 5, 10000, "positions of the first sweep (11)",
                                       Type::integer),
                     number_option_row("repeats", 1, 101, "readings a position (1)", Type::integer),
                     number_option_row("backlash", 0, 1e9,
                                       "moves downwards first go this much too far (0)"),
                     number_option_row("hysteresis", 0, 1,
                                       "values closer than this do not choose a side (0.02)")}}},
       "autofocus",
       "a search for the sharpest position, one step at a time",
       make_autofocus}};
}

const Class& autofocus_class() {
  static const Class kind{
      "autofocus",
      "one search; it moves nothing: make one with vision.autofocus",
      {{"start", {}, "number", "the first position", start},
       {"next",
        {needed("position", "where the stage is"), needed("value", "of the measure there")},
        "number; or nil, table",
        "where to go and measure next; at the end nil and what vision.focus.peak says, with "
        "readings, and park: where to leave the stage",
        next}},
      {}};
  return kind;
}

}  // namespace vitreo::lua
