// Bindings of tracker: objects followed by color and shape, frame by frame.
// SPDX-License-Identifier: Apache-2.0
#include "devices/roles/gray.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/vision/bind_vision.h"
#include "host/lua/vision/classes.h"
#include "vision/multi_tracker.h"

#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>
#include <time.h>
#include <vector>

namespace vitreo::lua {
namespace {

/// What a handle `tracker` holds.
struct Tracker {
  explicit Tracker(const std::vector<vision::TrackedObject>& each)
      : tracker(each), objects(each.size()) {}
  vision::MultiTracker tracker;
  std::size_t objects;
};

/// CPU time of this thread: what the tracker costs, without the other threads.
double cpu_seconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// One set for all objects of a tracker.
vision::ColorTrackerSettings tracker_settings(const Call& call) {
  vision::ColorTrackerSettings settings;
  settings.view = view_settings(call);
  if (const auto jump = call.number_option("jump_px")) settings.jump_px = *jump;
  if (const auto frames = call.number_option("coast_frames"))
    settings.coast_frames = static_cast<int>(*frames);
  settings.check();
  return settings;
}

/// One object is the case of a list of one: vision::MultiTracker gives it the track that a
/// vision::ColorTracker of its own would.
int make_tracker(Call& call) {
  const bool one = option_given(call, "model");
  if (one == option_given(call, "models"))
    throw std::invalid_argument("options: wants either model or models");
  const vision::ColorTrackerSettings settings = tracker_settings(call);
  std::vector<vision::TrackedObject> objects;
  if (one)
    objects.push_back({call.handle_option<TrainedModel>("model").model, settings});
  else
    for (const TrainedModel* trained : models_option(call))
      objects.push_back({trained->model, settings});
  push_handle(call.L, tracker_class(), std::make_shared<Tracker>(objects));
  return 1;
}

/// The time is the tracker's alone: CPU time of this thread, measured round the call, so that
/// neither other threads nor the map's copy count. A gray image is one without hue.
int update(Call& call) {
  auto& [tracker, objects] = call.self<Tracker>();
  const double start = cpu_seconds();
  const std::vector<vision::Track>& tracks = tracker.update(as_color(call.handle<Image>(0).pixels));
  const double took = cpu_seconds() - start;
  ResultTable table(call);
  table
      .list("tracks", tracks.size(),
            [&tracks](ResultTable& track, std::size_t i) { set_track(track, tracks[i]); })
      .number("cpu_time", took, "s");
  if (call.flag_option("owners")) {
    push_image(call.L, tracker.owners().clone());  // the next frame is mapped into the same pixels
    table.top("owners");
  }
  return 1;
}

/// Which object is meant, from 0. Only where there is one may it be left out: an ellipse for the
/// wrong object would make the tracker take one for the other.
std::size_t object_option(const Call& call, std::size_t objects) {
  const auto number = call.number_option("object");
  if (!number && objects > 1)
    throw std::invalid_argument("object: is missing; the tracker follows " +
                                std::to_string(objects));
  if (number && *number > static_cast<double>(objects))
    throw std::invalid_argument("object: wants 1 to " + std::to_string(objects) + ", got " +
                                std::to_string(static_cast<int>(*number)));
  return number ? static_cast<std::size_t>(*number) - 1 : 0;
}

/// As an operator points at it: the object is tracked from there in the next frame. An ellipse
/// outside of the image is refused by the tracker.
int place_object(Call& call) {
  auto& [tracker, objects] = call.self<Tracker>();
  vision::Ellipse at = ellipse_at(call.L, call.index(0), "ellipse");
  at.angle =
      std::remainder(at.angle, std::numbers::pi);  // an ellipse is the same after half a turn
  tracker.place(object_option(call, objects), at);
  return 0;
}

/// Back to searching in the whole image, as after a cut in the film.
int reset(Call& call) {
  call.self<Tracker>().tracker.reset();
  return 0;
}

}  // namespace

/// Thresholds come in pairs: F below the lower is ground, above the higher object, and between them
/// undecided (8.2).
vision::ObjectViewSettings view_settings(const Call& call) {
  vision::ObjectViewSettings settings;
  // An absent flag is not false here: both are on unless the script says otherwise.
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
  options.insert(options.begin(),
                 {handle_row("model", "color_model", "what the object looks like", true),
                  {.name = "models",
                   .type = Type::list,
                   .optional = true,
                   .help = "instead, of several: a color_model an object; equal ones may be the "
                           "same"}});
  options.push_back(
      number_option_row("jump_px", 1, 1000, "from where it is expected, in one frame (14)"));
  options.push_back(number_option_row(
      "coast_frames", 0, 1000, "unseen, before the whole image is searched (3)", Type::integer));
  return {{"vision.tracker",
           {options_of(options)},
           "tracker",
           "follows objects through images of the size trained: one, or several of different "
           "colors or alike, touching or not (8.3.1)",
           make_tracker,
           "vision.tracker { model = color_model }"}};
}

const Class& tracker_class() {
  const Argument object{.name = "object",
                        .type = Type::integer,
                        .optional = true,
                        .min = 1,
                        .max = vision::MultiTracker::kMostObjects,
                        .help = "which of several, in the order of models"};
  static const Class kind{
      "tracker",
      "follows objects by color and shape; make one with vision.tracker",
      {{"update",
        {handle_row("frame", "image", "the next one, in color"),
         options_of({flag_option_row("owners", "whose each pixel is, too (false)")})},
        {"table",
         {{"tracks", "", "one an object, in the order of models; the ellipse when tracking",
           track_fields()},
          {"cpu_time", "s", "that the frame took"},
          {.name = "owners",
           .help = "image, gray: 0, or the number of the object that has the pixel",
           .optional = true}}},
        "the tracks in the next frame",
        update,
        "tracker:update(image)"},
       {"set_ellipse",
        {{.name = "ellipse",
          .type = Type::table,
          .help = "{x_px, y_px, major_px, minor_px, angle}, as a track has them"},
         options_of({object})},
        "",
        "starts the tracking of an object at an ellipse",
        place_object,
        "tracker:set_ellipse { x_px = 50, y_px = 40, major_px = 60, minor_px = 30, angle = 0 }"},
       {"reset", {}, "", "forgets where the objects were", reset, "tracker:reset()"}}};
  return kind;
}

}  // namespace vitreo::lua
