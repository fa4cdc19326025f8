// Bindings of tracker and multi_tracker: objects followed by color and shape, frame by frame.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/tables.h"
#include "host/lua/vision/bind_vision.h"
#include "host/lua/vision/classes.h"
#include "vision/color_tracker.h"
#include "vision/multi_tracker.h"

#include <cmath>
#include <numbers>
#include <stdexcept>
#include <time.h>

namespace vitreo::lua {
namespace {

/// CPU time of this thread: what the tracker costs, without the other threads.
double cpu_seconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

vision::ColorTrackerSettings tracker_settings(const Call& call) {
  vision::ColorTrackerSettings settings;
  settings.view = view_settings(call);
  if (const auto jump = call.number_option("jump_px")) settings.jump_px = *jump;
  if (const auto frames = call.number_option("coast_frames"))
    settings.coast_frames = static_cast<int>(*frames);
  settings.check();
  return settings;
}

int make_tracker(Call& call) {
  const auto& trained = call.handle_option<TrainedModel>("model");
  push_handle(call.L, tracker_class(),
              std::make_shared<vision::ColorTracker>(trained.model, tracker_settings(call)));
  return 1;
}

int update(Call& call) {
  const cv::Mat& image = call.handle<Image>(0).pixels;
  vision::Owned owned;
  if (call.has(1)) {
    owned.map = call.handle<Image>(1).pixels;
    owned.self = 255;
  }
  const double start = cpu_seconds();
  const vision::Track track = call.self<vision::ColorTracker>().update(image, owned);
  const double took = cpu_seconds() - start;
  ResultTable table(call);
  set_track(table, track);
  table.number("cpu_time", took, "s");
  return 1;
}

int make_multi_tracker(Call& call) {
  std::vector<vision::TrackedObject> objects;
  const vision::ColorTrackerSettings settings = tracker_settings(call);
  for (const TrainedModel* trained : models_option(call))
    objects.push_back({trained->model, settings});
  push_handle(call.L, multi_tracker_class(), std::make_shared<vision::MultiTracker>(objects));
  return 1;
}

int update_all(Call& call) {
  const double start = cpu_seconds();
  const std::vector<vision::Track>& tracks =
      call.self<vision::MultiTracker>().update(call.handle<Image>(0).pixels);
  const double took = cpu_seconds() - start;
  ResultTable(call)
      .list("tracks", tracks.size(),
            [&tracks](ResultTable& table, std::size_t i) { set_track(table, tracks[i]); })
      .number("cpu_time", took, "s");
  return 1;
}

int owners(Call& call) {
  const cv::Mat& map = call.self<vision::MultiTracker>().owners();
  if (map.empty()) throw std::runtime_error("no image was looked at yet");
  push_image(call.L, map.clone());
  return 1;
}

vision::Ellipse ellipse_argument(const Call& call, std::size_t argument) {
  vision::Ellipse at = ellipse_at(call.L, call.index(argument), "ellipse");
  at.angle = std::remainder(at.angle, std::numbers::pi);
  return at;
}

int set_ellipse_of(Call& call) {
  call.self<vision::MultiTracker>().place(static_cast<std::size_t>(call.number(0)) - 1,
                                          ellipse_argument(call, 1));
  return 0;
}

int reset_all(Call& call) {
  call.self<vision::MultiTracker>().reset();
  return 0;
}

int set_ellipse(Call& call) {
  call.self<vision::ColorTracker>().place(ellipse_argument(call, 0));
  return 0;
}

int reset(Call& call) {
  call.self<vision::ColorTracker>().reset();
  return 0;
}

}  // namespace

vision::ObjectViewSettings view_settings(const Call& call) {
  vision::ObjectViewSettings settings;
  const auto flag = [&call](const char* name, bool fallback) {
    call.push_option(name);
    const bool value = lua_isnil(call.L, -1) ? fallback : lua_toboolean(call.L, -1);
    lua_pop(call.L, 1);
    return value;
  };
  settings.shape_prior = flag("shape_prior", settings.shape_prior);
  settings.refine = flag("refine", settings.refine);
  if (const auto gate = call.number_option("gate_px")) settings.gate_px = *gate;
  const auto low = call.number_option("threshold_low"), high = call.number_option("threshold_high");
  if (low.has_value() != high.has_value())
    throw std::invalid_argument(
        "threshold_low, threshold_high: one is missing; they come together");
  if (low) settings.thresholds = vision::Thresholds{*low, *high};
  settings.check();
  return settings;
}

std::vector<Argument> view_options() {
  return {
      flag_option_row("shape_prior", "cycle three of the level set, with the eigenshapes (true)"),
      flag_option_row("refine",
                      "the rim to a fraction of a pixel; else the level set's moments (true)"),
      number_option_row("gate_px", 2, 100,
                        "how far outside the expected rim the object may be (9)"),
      number_option_row("threshold_low", -8, 8, "of F: ground below it (learnt)"),
      number_option_row("threshold_high", -8, 8, "of F: object above it (learnt)")};
}

std::vector<Binding> vision_tracker_rows() {
  std::vector<Argument> options = view_options();
  options.insert(options.begin(), handle_row("model", "color_model", "what it looks like"));
  options.push_back(
      number_option_row("jump_px", 1, 1000, "from where it is expected, in one frame (14)"));
  options.push_back(number_option_row(
      "coast_frames", 0, 1000, "unseen, before the whole image is searched (3)", Type::integer));
  std::vector<Argument> several = options;
  several[0] = {.name = "models",
                .type = Type::list,
                .help = "a color_model an object; equal ones may be the same"};
  return {{"vision.multi_tracker",
           {options_of(several)},
           "multi_tracker",
           "follows several objects, of different colors or alike, touching or not (8.3.1)",
           make_multi_tracker,
           "vision.multi_tracker { models = { color_model } }"},
          {"vision.tracker",
           {options_of(options)},
           "tracker",
           "follows one object through images of the size trained",
           make_tracker,
           "vision.tracker { model = color_model }"}};
}

const Class& tracker_class() {
  std::vector<ResultField> fields = track_fields();
  fields.push_back({"cpu_time", "s", "that the frame took"});
  static const Class kind{
      "tracker",
      "follows one object; make one with vision.tracker",
      {{"update",
        {handle_row("frame", "image", "the next one, in color"),
         handle_row("owned", "image", "gray: not 0 where another object is", true)},
        {"table", fields},
        "the track in the next frame; the ellipse when tracking",
        update,
        "tracker:update(image)"},
       {"set_ellipse",
        {{.name = "ellipse",
          .type = Type::table,
          .help = "{x_px, y_px, major_px, minor_px, angle}"}},
        "",
        "starts the tracking at an ellipse",
        set_ellipse,
        "tracker:set_ellipse { x_px = 50, y_px = 40, major_px = 60, minor_px = 30, angle = 0 }"},
       {"reset", {}, "", "forgets where it was", reset, "tracker:reset()"}}};
  return kind;
}

const Class& multi_tracker_class() {
  static const Class kind{
      "multi_tracker",
      "follows several objects; make one with vision.multi_tracker",
      {{"update",
        {handle_row("frame", "image", "the next one, in color")},
        {"table",
         {{"tracks", "", "one an object, as tracker:update has it", track_fields()},
          {"cpu_time", "s", "that the frame took"}}},
        "the tracks in the next frame",
        update_all,
        "multi_tracker:update(image)"},
       {"owners",
        {},
        "image",
        "gray: 0, or the number of the object that has the pixel",
        owners,
        "multi_tracker:owners()"},
       {"set_ellipse",
        {{.name = "object",
          .type = Type::integer,
          .min = 1,
          .max = vision::MultiTracker::kMostObjects},
         {.name = "ellipse",
          .type = Type::table,
          .help = "{x_px, y_px, major_px, minor_px, angle}"}},
        "",
        "starts the tracking of an object at an ellipse",
        set_ellipse_of,
        "multi_tracker:set_ellipse(1, { x_px = 50, y_px = 40, major_px = 60, minor_px = 30, angle "
        "= 0 })"},
       {"reset", {}, "", "forgets where they were", reset_all, "multi_tracker:reset()"}}};
  return kind;
}

}  // namespace vitreo::lua
