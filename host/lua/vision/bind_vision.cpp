// SPDX-License-Identifier: Apache-2.0
#include "host/lua/vision/bind_vision.h"

#include "devices/roles/gray.h"
#include "host/config/config.h"
#include "host/lua/interpreter/errors.h"
#include "host/lua/interpreter/state.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/vision/classes.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>

namespace vitreo::lua {
namespace {

/// A finite number of a table that a script wrote down.
double field(lua_State* L, int index, const char* key, const std::string& name) {
  lua_getfield(L, index, key);
  if (lua_type(L, -1) != LUA_TNUMBER || !std::isfinite(lua_tonumber(L, -1)))
    throw std::invalid_argument(name + ": " + key + ": wants a number, got " + kind_of(L, -1));
  const double value = lua_tonumber(L, -1);
  lua_pop(L, 1);
  return value;
}

/// Its address is the registry's key of the counter below; the value means nothing.
const char kImageBytes = 0;

template <class Read>
/// Calls read(index, where) for each entry of a list that must not be empty, the entry on top of
/// the stack; what read leaves there is popped.
void each_of_list(const Call& call, const char* option, Read read) {
  if (!call.push_option(option)) throw std::invalid_argument(std::string(option) + ": is missing");
  const int list = lua_gettop(call.L);
  const auto count = static_cast<lua_Integer>(lua_rawlen(call.L, list));
  if (count == 0) throw std::invalid_argument(std::string(option) + ": is empty");
  for (lua_Integer i = 1; i <= count; ++i) {
    lua_rawgeti(call.L, list, i);
    read(lua_gettop(call.L), std::string(option) + ": entry " + std::to_string(i));
    lua_settop(call.L, list);
  }
  lua_pop(call.L, 1);
}

/// What the handle of that class at `index` holds.
template <class T>
/// Throws std::invalid_argument naming `where` for another value or another class of handle. A
/// list's entries are checked here: their row says only that it is a list.
const T& object_at(lua_State* L, int index, const Class& kind, const std::string& where) {
  if (handle_class(L, index) != &kind)
    throw std::invalid_argument(where + ": wants " +
                                wanted({.type = Type::handle, .handle = kind.name}) + ", got " +
                                kind_of(L, index));
  return *static_cast<T*>(handle_object(L, index));
}

const Image& image_at(lua_State* L, int index, const std::string& where) {
  return object_at<Image>(L, index, image_class(), where);
}

}  // namespace

void push_image(lua_State* L, const cv::Mat& pixels) {
  constexpr std::size_t kMost = std::size_t{512} << 20U, kCollectEvery = std::size_t{64} << 20U;
  struct Counter {
    std::size_t living = 0, since_collection = 0;
  };
  // A reader that failed would show here first: no handle without pixels.
  if (pixels.empty()) throw std::invalid_argument("the image is empty");
  if (lua_rawgetp(L, LUA_REGISTRYINDEX, &kImageBytes) != LUA_TUSERDATA) {
    lua_pop(L, 1);
    // One counter a state, kept by the registry. Images share it, since they may be collected after
    // it when the state closes.
    new (lua_newuserdatauv(L, sizeof(std::shared_ptr<Counter>), 0))
        std::shared_ptr<Counter>(std::make_shared<Counter>());
    lua_createtable(L, 0, 1);
    lua_pushcfunction(L, [](lua_State* state) {
      static_cast<std::shared_ptr<Counter>*>(lua_touserdata(state, 1))->~shared_ptr();
      return 0;
    });
    lua_setfield(L, -2, "__gc");
    lua_setmetatable(L, -2);
    lua_pushvalue(L, -1);
    lua_rawsetp(L, LUA_REGISTRYINDEX, &kImageBytes);
  }
  const std::shared_ptr<Counter> counter =
      *static_cast<std::shared_ptr<Counter>*>(lua_touserdata(L, -1));
  lua_pop(L, 1);
  const std::size_t bytes = pixels.total() * pixels.elemSize();
  // Lua's collector paces itself by its own memory, where an image is a handle of some bytes: so
  // after every 64 MB of new images it is told to run, and before an error for the limit as well.
  counter->since_collection += bytes;
  if (counter->since_collection > kCollectEvery || counter->living + bytes > kMost) {
    lua_gc(L, LUA_GCCOLLECT);
    counter->since_collection = 0;
  }
  if (counter->living + bytes > kMost)
    throw std::runtime_error("the script holds more than 512 MB of images");
  counter->living += bytes;
  push_handle(L, image_class(),
              std::shared_ptr<Image>(new Image{pixels}, [counter, bytes](Image* image) {
                counter->living -= bytes;
                delete image;
              }));
}

/// Full axes, as outlines are drawn and as the thesis' tables have them; semi-axes inside C++.
std::vector<ResultField> ellipse_fields(bool optional) {
  std::vector<ResultField> fields{{"x_px", "", "center"},
                                  {"y_px", "", "center"},
                                  {"major_px", "", "full axis"},
                                  {"minor_px", "", "full axis"},
                                  {"angle", "rad", "of the major axis, from +u towards +v"}};
  for (ResultField& field : fields) field.optional = optional;
  return fields;
}

/// C++ has semi-axes, scripts have full axes.
void set_ellipse(ResultTable& table, const vision::Ellipse& e) {
  table.number("x_px", e.center_px.x())
      .number("y_px", e.center_px.y())
      .number("major_px", 2 * e.semi_major_px)
      .number("minor_px", 2 * e.semi_minor_px)
      .number("angle", e.angle, "rad");
}

void push_names(lua_State* L, const std::vector<std::string>& names) {
  lua_createtable(L, static_cast<int>(names.size()), 0);
  for (std::size_t i = 0; i < names.size(); ++i) {
    lua_pushlstring(L, names[i].data(), names[i].size());
    lua_rawseti(L, -2, static_cast<lua_Integer>(i + 1));
  }
}

/// Throws for axes that are swapped, too: the angle is that of the longer one.
vision::Ellipse ellipse_at(lua_State* L, int index, const std::string& name) {
  vision::Ellipse e;
  e.center_px = {field(L, index, "x_px", name), field(L, index, "y_px", name)};
  e.semi_major_px = field(L, index, "major_px", name) / 2;
  e.semi_minor_px = field(L, index, "minor_px", name) / 2;
  e.angle = field(L, index, "angle", name);
  if (!(e.semi_minor_px > 0) || e.semi_major_px < e.semi_minor_px)
    throw std::invalid_argument(name + ": its axes are not those of an ellipse");
  return e;
}

/// The ellipse and its certainty are there only while the object is measured; the state always is.
std::vector<ResultField> track_fields() {
  std::vector<ResultField> fields = ellipse_fields(true);
  fields.insert(fields.begin(), {"state", "", "searching, tracking, coasting or lost"});
  for (ResultField field : {ResultField{"covariance", "", "of these five, 25 numbers by rows"},
                            ResultField{"inliers", "", "part of the rim's points"},
                            ResultField{"support", "", "of the ellipse by the image, 0 to 1"},
                            ResultField{"expected", "", "ellipse", ellipse_fields()},
                            ResultField{"heading", "rad",
                                        "from the center to the tip, from +u towards +v, where "
                                        "one was taught and is 99 % sure"},
                            ResultField{"heading_probability", "", "that it is not opposite"},
                            ResultField{"tip",
                                        "",
                                        "of the object, with the heading",
                                        {{"x_px", "", ""},
                                         {"y_px", "", ""},
                                         {"covariance", "", "4 numbers by rows, px^2"},
                                         {"seen", "", "or where the ellipse says that it is"}}}}) {
    field.optional = true;
    fields.push_back(std::move(field));
  }
  return fields;
}

/// Only a track that was measured in this frame has an ellipse: the predicted one stands apart as
/// `expected`, so that it is not taken for a measurement.
void set_track(ResultTable& table, const vision::Track& track) {
  if (track.measured) {
    set_ellipse(table, track.measured->ellipse);
    // Of the full axes, as the numbers beside it: twice the semi-axes' errors.
    const Eigen::Matrix<double, 5, 1> full =
        (Eigen::Matrix<double, 5, 1>() << 1, 1, 2, 2, 1).finished();
    const Eigen::Matrix<double, 5, 5> covariance =
        full.asDiagonal() * track.measured->covariance * full.asDiagonal();
    table.numbers("covariance", {covariance.data(), covariance.data() + covariance.size()})
        .number("inliers", track.measured->inlier_fraction)
        .number("support", track.support);
  }
  if (track.heading)
    table.number("heading", track.heading->angle, "rad")
        .number("heading_probability", track.heading->probability);
  if (track.tip)
    table.table("tip", [&tip = *track.tip](ResultTable& result) {
      result.number("x_px", tip.at_px.x())
          .number("y_px", tip.at_px.y())
          .numbers("covariance", {tip.covariance.data(), tip.covariance.data() + 4})
          .flag("seen", tip.seen);
    });
  table.text("state", name_of(track.state));
  if (track.expected)
    table.table("expected",
                [&track](ResultTable& expected) { set_ellipse(expected, *track.expected); });
}

Argument labeled_argument() {
  return {.name = "images",
          .type = Type::list,
          .help =
              "{{image = image, mask = image}, ...}, as vision.training gives; tip = {x_px, "
              "y_px} of four or more teaches heading and tip"};
}

/// The pixels are shared, not copied: nothing changes an image once it is made. A gray camera's are
/// colors without hue.
std::vector<vision::LabeledImage> labeled_option(const Call& call) {
  std::vector<vision::LabeledImage> images;
  each_of_list(call, "images", [&](int index, const std::string& where) {
    if (!lua_istable(call.L, index))
      throw std::invalid_argument(where + ": wants {image = , mask = }, got " +
                                  kind_of(call.L, index));
    lua_getfield(call.L, index, "image");
    lua_getfield(call.L, index, "mask");
    images.push_back({as_color(image_at(call.L, index + 1, where + ": image").pixels),
                      image_at(call.L, index + 2, where + ": mask").pixels});
  });
  return images;
}

/// Where the object's head ends, as a person pointed at it, in as many of the images as wanted.
std::vector<Eigen::Vector2d> tips_option(const Call& call) {
  constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  std::vector<Eigen::Vector2d> tips;
  each_of_list(call, "images", [&](int index, const std::string& where) {
    tips.emplace_back(kUnknown, kUnknown);
    lua_getfield(call.L, index, "tip");
    if (lua_isnil(call.L, -1)) return;
    if (!lua_istable(call.L, -1))
      throw std::invalid_argument(where + ": tip: wants {x_px = , y_px = }, got " +
                                  kind_of(call.L, -1));
    const int tip = lua_gettop(call.L);
    tips.back() = {field(call.L, tip, "x_px", where + ": tip"),
                   field(call.L, tip, "y_px", where + ": tip")};
  });
  return tips;
}

std::vector<cv::Mat> images_option(const Call& call) {
  std::vector<cv::Mat> images;
  each_of_list(call, "images", [&](int index, const std::string& where) {
    images.push_back(image_at(call.L, index, where).pixels);
  });
  return images;
}

/// Pointers hold as long as the call: its arguments keep the handles alive.
std::vector<const TrainedModel*> models_option(const Call& call) {
  std::vector<const TrainedModel*> models;
  each_of_list(call, "models", [&](int index, const std::string& where) {
    models.push_back(&object_at<TrainedModel>(call.L, index, color_model_class(), where));
  });
  return models;
}

/// Whether it stands in the options, be it false.
bool option_given(const Call& call, const std::string& name) {
  const bool given = call.push_option(name);
  lua_pop(call.L, 1);
  return given;
}

Argument flag_option_row(const char* name, const char* help) {
  return {.name = name, .type = Type::flag, .optional = true, .help = help};
}

Argument number_option_row(const char* name, double min, double max, const char* help, Type type) {
  return {.name = name, .type = type, .optional = true, .min = min, .max = max, .help = help};
}

Argument handle_row(const char* name, const char* kind, const char* help, bool optional) {
  return {.name = name, .type = Type::handle, .optional = optional, .help = help, .handle = kind};
}

const std::vector<Binding>& vision_functions() {
  static const std::vector<Binding> functions = [] {
    std::vector<Binding> all;
    for (auto rows :
         {vision_image_rows(), vision_model_rows(), vision_tracker_rows(), vision_background_rows(),
          vision_focus_rows(), vision_mosaic_rows(), vision_retina_rows()})
      for (Binding& row : rows) all.push_back(std::move(row));
    return all;
  }();
  return functions;
}

}  // namespace vitreo::lua
