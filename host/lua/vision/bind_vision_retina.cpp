// Binding of retina_map: where each frame of a moving view lies on the retina, and the picture of
// the map as it grows.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/vision/bind_vision.h"
#include "host/lua/vision/classes.h"
#include "vision/retina_map.h"
#include "vision/retina_picture.h"

#include <time.h>

namespace vitreo::lua {
namespace {

/// What a handle `retina_map` holds.
struct LuaRetinaMap {
  explicit LuaRetinaMap(const vision::RetinaMapSettings& settings) : map(settings) {}
  vision::RetinaMap map;
  vision::RetinaPicture picture;
  std::optional<vision::RetinaPose> last;
};

int make_retina_map(Call& call) {
  vision::RetinaMapSettings settings;
  if (const auto px = call.number_option("flatten_px")) settings.flatten_px = *px;
  if (const auto least = call.number_option("min_correlation")) settings.min_correlation = *least;
  if (const auto share = call.number_option("min_overlap")) settings.min_overlap = *share;
  if (const auto share = call.number_option("grow_overlap")) settings.grow_overlap = *share;
  push_handle(call.L, retina_map_class(), std::make_shared<LuaRetinaMap>(settings));
  return 1;
}

/// CPU time of this thread.
double cpu_time() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// The frame becomes a part of the picture where it became a part of the map.
int update_retina(Call& call) {
  auto& self = call.self<LuaRetinaMap>();
  const cv::Mat& image = call.handle<Image>(0).pixels;
  std::vector<vision::Ellipse> bodies;
  if (call.push_option("body")) {
    lua_getfield(call.L, -1, "x_px");  // a track that was not measured has no place
    const bool there = !lua_isnil(call.L, -1);
    lua_pop(call.L, 1);
    if (there) bodies.push_back(ellipse_at(call.L, lua_gettop(call.L), "body"));
  }
  lua_pop(call.L, 1);
  const double start = cpu_time();
  self.last = self.map.update(image, bodies);
  const double took = cpu_time() - start;
  if (!self.last) return 0;
  const vision::RetinaPose& pose = *self.last;
  if (pose.grew) self.picture.add(image, pose.map_from_image);
  ResultTable(call)
      .number("x_px", pose.map_from_image.translation().x())
      .number("y_px", pose.map_from_image.translation().y())
      .number("angle", pose.angle(), "rad")
      .number("scale", pose.scale())
      .number("sigma_px", pose.sigma_px)
      .number("correlation", pose.correlation)
      .number("overlap", pose.overlap)
      .flag("grew", pose.grew)
      .number("cpu_time", took, "s");
  return 1;
}

const vision::RetinaPose& pose_of_last(const Call& call) {
  const auto& last = call.self<LuaRetinaMap>().last;
  if (!last)
    throw std::logic_error("there is no place of the last frame: it was not found on the map");
  return *last;
}

/// A table {x_px, y_px}.
int push_point(const Call& call, const Eigen::Vector2d& at) {
  ResultTable(call).number("x_px", at.x()).number("y_px", at.y());
  return 1;
}

Eigen::Vector2d point_argument(const Call& call) { return {call.number(0), call.number(1)}; }

int to_map(Call& call) {
  return push_point(call, pose_of_last(call).map_from_image * point_argument(call));
}

int to_image(Call& call) {
  return push_point(call, pose_of_last(call).map_from_image.inverse() * point_argument(call));
}

int stabilize(Call& call) {
  push_image(call.L, vision::stabilized(call.handle<Image>(0).pixels, pose_of_last(call)));
  return 1;
}

int map_picture(Call& call) {
  const auto& self = call.self<LuaRetinaMap>();
  const cv::Mat image = self.picture.image();
  if (image.empty()) return 0;
  const Eigen::Vector2d origin = self.picture.pixel_of({0, 0});
  ResultTable table(call);
  table.number("x_px", origin.x()).number("y_px", origin.y());
  table.integer("frames", self.map.frames());
  push_image(call.L, image);
  table.top("image");
  return 1;
}

std::vector<Argument> point_arguments(const char* where) {
  return {{.name = "x_px", .type = Type::number, .help = where},
          {.name = "y_px", .type = Type::number, .help = where}};
}

Returned point_fields(const char* where) {
  return {"table", {{"x_px", "", where}, {"y_px", "", where}}};
}

Returned pose_fields() {
  return Returned("table", {{"x_px", "", "of the frame's first pixel, in the map"},
                            {"y_px", "", "of the frame's first pixel, in the map"},
                            {"angle", "rad", "of the frame against the map's first"},
                            {"scale", "", "of the map over the frame"},
                            {"sigma_px", "", "standard deviation of a point's place in the map"},
                            {"correlation", "", "of the frame with the map"},
                            {"overlap", "", "share of the map's nearest frame in view"},
                            {"grew", "", "whether the frame became a part of the map"},
                            {"cpu_time", "s", "that the frame took"}})
      .or_nil("where it is not found on the map");
}

}  // namespace

std::vector<Binding> vision_retina_rows() {
  return {{"vision.retina_map",
           {options_of(
               {number_option_row("flatten_px", 8, 1000,
                                  "structure larger than this is light, not retina (40)"),
                number_option_row("min_correlation", 0.05, 0.95, "of a frame with the map (0.5)"),
                number_option_row("min_overlap", 0.05, 0.9,
                                  "share of the map's nearest frame in view (0.35)"),
                number_option_row("grow_overlap", 0.1, 0.95,
                                  "below it a frame becomes a part of the map (0.7)")})},
           "retina_map",
           "finds each frame of a moving view on the retina, at camera rate",
           make_retina_map,
           "vision.retina_map {}"}};
}

const Class& retina_map_class() {
  static const Class kind{
      "retina_map",
      "the retina as the frames show it; its coordinates are those of the first frame, px; make "
      "one "
      "with vision.retina_map",
      {{"update",
        {handle_row("frame", "image", "the next one"),
         options_of({{.name = "body",
                      .type = Type::table,
                      .optional = true,
                      .help = "a track, or an ellipse as it has one: what is not retina"}})},
        pose_fields(),
        "where the next frame lies on the map; the first one makes it",
        update_retina,
        "retina_map:update(image)"},
       {"to_map", point_arguments("in the last frame"), point_fields("in the map"),
        "a place of the last frame on the map", to_map, "retina_map:to_map(50, 40)"},
       {"to_image", point_arguments("in the map"), point_fields("in the last frame"),
        "a place of the map in the last frame", to_image, "retina_map:to_image(50, 40)"},
       {"stabilize",
        {handle_row("frame", "image", "the last one")},
        "image",
        "the last frame as the first one saw it: the retina stands still",
        stabilize,
        "retina_map:stabilize(image)"},
       {"picture",
        {},
        Returned("table", {{"image", "", "of all frames that the map is made of"},
                           {"x_px", "", "of the map's origin in it"},
                           {"y_px", "", "of the map's origin in it"},
                           {"frames", "", "how many"}})
            .or_nil("before the first frame"),
        "the map's picture so far",
        map_picture,
        "retina_map:picture()"}}};
  return kind;
}

}  // namespace vitreo::lua
