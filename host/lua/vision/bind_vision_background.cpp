// Bindings of background_tracker: one object by background subtraction, as in the thesis' own
// experiments.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/vision/bind_vision.h"
#include "host/lua/vision/classes.h"
#include "vision/background_tracker.h"

namespace vitreo::lua {
namespace {

/// Absent options keep the defaults of BackgroundTrackerSettings, whose check() names a bad one.
int make(Call& call) {
  vision::BackgroundTrackerSettings settings;
  if (const auto kind = call.text_option("kind")) settings.kind = vision::background_kind(*kind);
  if (const auto level = call.number_option("threshold")) settings.threshold = *level;
  if (const auto rate = call.number_option("rate")) settings.rate = *rate;
  if (const auto area = call.number_option("min_area_px")) settings.min_area_px = *area;
  if (const auto area = call.number_option("max_area_px")) settings.max_area_px = *area;
  push_handle(call.L, background_tracker_class(),
              std::make_shared<vision::BackgroundTracker>(settings));
  return 1;
}

/// An image without the object, of the first one's size and type.
int learn(Call& call) {
  call.self<vision::BackgroundTracker>().learn(call.handle<Image>(0).pixels);
  return 0;
}

/// Nothing where nothing differs: absence of the object is a result. Before anything was learnt it
/// is an error.
int update_background(Call& call) {
  const auto found = call.self<vision::BackgroundTracker>().update(call.handle<Image>(0).pixels);
  if (!found) return 0;
  ResultTable table(call);
  set_ellipse(table, *found);
  return 1;
}

}  // namespace

std::vector<Binding> vision_background_rows() {
  return {
      {"vision.background_tracker",
       {{.name = "options",
         .type = Type::options,
         .options = {{.name = "kind",
                      .type = Type::text,
                      .optional = true,
                      .help = "fixed: as learnt; running: a mean that follows",
                      .choices = {"fixed", "running", "mog2", "knn"}},
                     number_option_row("threshold", 1, 255,
                                       "gray levels, of fixed and running (25)"),
                     number_option_row("rate", 0, 1,
                                       "share of each frame that the background takes on (0.02)"),
                     number_option_row("min_area_px", 1, 1e8, "of what can be the object (60)"),
                     number_option_row("max_area_px", 1, 1e8,
                                       "of what can be the object (10 % of the image)")}}},
       "background_tracker",
       "finds the largest thing that differs from the empty scene (thesis 5.5)",
       make,
       "vision.background_tracker { kind = \"running\" }"}};
}

const Class& background_tracker_class() {
  static const Class kind{"background_tracker",
                          "background subtraction; make one with vision.background_tracker",
                          {{"learn",
                            {handle_row("frame", "image", "of the empty scene")},
                            "",
                            "learns the empty scene",
                            learn,
                            "background_tracker:learn(image)"},
                           {"update",
                            {handle_row("frame", "image", "the next one")},
                            Returned("table", ellipse_fields()).or_nil("where nothing differs"),
                            "the ellipse of what differs",
                            update_background,
                            "background_tracker:update(image)"}}};
  return kind;
}

}  // namespace vitreo::lua
