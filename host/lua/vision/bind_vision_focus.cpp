// Bindings of focus: measures of an image's sharpness, the fit of their peak, the autofocus search.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/tables.h"
#include "host/lua/vision/bind_vision.h"
#include "host/lua/vision/classes.h"
#include "vision/autofocus.h"
#include "vision/focus.h"

#include <opencv2/imgproc.hpp>

#include <stdexcept>
#include <string>
#include <utility>

namespace vitreo::lua {
namespace {

/// Focus is measured on gray levels; a gray image is shared, not copied.
cv::Mat gray_of(const cv::Mat& image) {
  if (image.channels() == 1) return image;
  cv::Mat gray;
  cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
  return gray;
}

/// In the library's order, for the row's choices and the call that lists them.
std::vector<std::string> measure_names() {
  std::vector<std::string> names;
  for (const vision::FocusMeasure measure : vision::focus_measures())
    names.emplace_back(vision::name_of(measure));
  return names;
}

int focus_measures(Call& call) {
  push_names(call.L, measure_names());
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

/// `saturated` comes with the value: a clipped window has less contrast than its focus deserves.
int focus(Call& call) {
  const cv::Mat gray = gray_of(call.self<Image>().pixels);
  cv::Rect window({0, 0}, gray.size());
  vision::FocusMeasure how = vision::kDefaultFocusMeasure;
  if (call.has(0)) {
    window = window_option(call, gray.size());
    if (const auto name = call.text_option("measure")) how = vision::focus_measure(*name);
  }
  const vision::FocusReading reading = vision::focus(gray, window, how);
  ResultTable(call)
      .number("value", reading.value)
      .number("mean", reading.mean)
      .number("saturated", reading.saturated)
      .number("pixels", static_cast<double>(reading.pixels));
  return 1;
}

/// The peak's fields are there exactly when the answer is "found".
void set_fit(ResultTable& table, const vision::FocusPeakFit& fit) {
  table.number("noise", fit.noise).text("answer", std::string(vision::name_of(fit.answer)));
  if (fit.peak)
    table.number("position", fit.peak->position)
        .number("sigma", fit.peak->sigma)
        .number("value", fit.peak->value);
}

/// `optional`: whether even the answer may be absent, as in the steps of a search.
std::vector<ResultField> fit_fields(bool optional) {
  const auto field = [](const char* name, const char* help, bool may_be_nil) {
    return ResultField{.name = name, .help = help, .optional = may_be_nil};
  };
  return {field("answer", "found, at low end, at high end, no peak", optional),
          field("noise", "of the values", true), field("position", "of the peak, when found", true),
          field("sigma", "of the position", true), field("value", "at the peak", true)};
}

/// Unit and direction of positions are the caller's: the peak comes back in the same.
int focus_peak(Call& call) {
  const std::vector<double> positions = *call.numbers_option("positions"),
                            values = *call.numbers_option("values");
  if (positions.size() != values.size())
    throw std::invalid_argument("values: has " + std::to_string(values.size()) +
                                " numbers, positions has " + std::to_string(positions.size()));
  std::vector<vision::FocusSample> samples;
  for (std::size_t i = 0; i < positions.size(); ++i) samples.push_back({positions[i], values[i]});
  ResultTable table(call);
  set_fit(table, vision::find_focus_peak(samples));
  return 1;
}

/// The search moves nothing and measures nothing: the script does both, between its steps.
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

/// Without a reading the search begins: where to measure first. With one it goes on.
int next(Call& call) {
  auto& search = call.self<vision::Autofocus>();
  const auto position = call.number_option("position"), value = call.number_option("value");
  if (position.has_value() != value.has_value())
    throw std::invalid_argument("position, value: one is missing; they come together");
  ResultTable table(call);
  if (!position) {
    table.number("move_to", search.start());
    return 1;
  }
  const vision::AutofocusStep step = search.next(*position, *value);
  if (const double* target = std::get_if<double>(&step)) {
    table.number("move_to", *target);
    return 1;
  }
  const auto& done = std::get<vision::AutofocusResult>(step);
  set_fit(table, done.fit);
  table.number("readings", static_cast<double>(done.readings));
  if (done.park) table.number("park", *done.park);
  return 1;
}

/// Positions and values have no unit of their own: a stage's or a lens mover's, in whatever it
/// counts.
Argument needed(const char* name, const char* help) {
  return {.name = name, .type = Type::number, .help = help};
}

}  // namespace

Binding focus_row() {
  const auto whole = [](const char* name) {
    return number_option_row(name, -1e6, 1e6, "of the window, px (the image)", Type::integer);
  };
  return {"focus",
          {options_of({{.name = "measure",
                        .type = Type::text,
                        .optional = true,
                        .help = "(smoothed_tenengrad); normalized_variance is the thesis'",
                        .choices = measure_names()},
                       whole("x"),
                       whole("y"),
                       whole("width"),
                       whole("height")})},
          {"table",
           {{"value", "", "of the measure"},
            {"mean", "", "gray level"},
            {"saturated", "", "part of the pixels"},
            {"pixels", "", "how many"}}},
          "how sharp the image is, or a window of it",
          focus,
          "image:focus { measure = \"normalized_variance\" }"};
}

std::vector<Binding> vision_focus_rows() {
  const auto numbers = [](const char* name, const char* help) {
    return Argument{.name = name, .type = Type::numbers, .help = help};
  };
  return {
      {"vision.focus_measures",
       {},
       "list of names",
       "the focus measures that are known",
       focus_measures,
       "vision.focus_measures()"},
      {"vision.focus_peak",
       {options_of({numbers("positions", "in any one unit"),
                    numbers("values", "of a focus measure there")})},
       {"table", fit_fields(false)},
       "where a focus measure peaks",
       focus_peak,
       "vision.focus_peak { positions = { 0, 1, 2, 3, 4 }, values = { 1, 2, 5, 2, 1 } }"},
      {"vision.autofocus",
       {options_of(
           {needed("low", "of the travel"),
            needed("high", "of the travel"),
            needed("step", "the finest"),
            {.name = "strategy",
             .type = Type::text,
             .optional = true,
             .help = "how the travel is searched (coarse_to_fine)",
             .choices = {"coarse_to_fine", "sweep", "golden_section", "fibonacci"}},
            number_option_row("coarse", 5, 10000, "positions of the first sweep (11)",
                              Type::integer),
            number_option_row("repeats", 1, 101, "readings a position (1)", Type::integer),
            number_option_row("backlash", 0, 1e9, "moves downwards first go this much too far (0)"),
            number_option_row("hysteresis", 0, 1,
                              "values closer than this do not choose a side (0.02)")})},
       "autofocus",
       "a search for the sharpest position, one step at a time",
       make_autofocus,
       "vision.autofocus { low = -1 * mm, high = 1 * mm, step = 50 * um }"}};
}

const Class& autofocus_class() {
  const auto field = [](const char* name, const char* help) {
    return ResultField{.name = name, .help = help, .optional = true};
  };
  std::vector<ResultField> step = fit_fields(true);
  step.insert(step.begin(), field("move_to", "where to measure next; nil at the end"));
  step.push_back(field("readings", "how many it took"));
  step.push_back(field("park", "where to leave the stage"));
  const auto reading = [](const char* name, const char* help) {
    Argument made = needed(name, help);
    made.optional = true;
    return made;
  };
  static const Class kind{
      "autofocus",
      "one search; it moves nothing: make one with vision.autofocus",
      {{"next",
        {options_of(
            {reading("position", "where the stage is"), reading("value", "of the measure there")})},
        {"table", step},
        "the next step by what was measured, the first one by nothing; at the end the peak, as "
        "vision.focus_peak has it",
        next,
        "search:next { position = 0.1 * mm, value = 3.5 }"}}};
  return kind;
}

}  // namespace vitreo::lua
