// vision.color_model: colors and shapes learnt from images with masks.
// SPDX-License-Identifier: Apache-2.0
#include "host/files/run_folder.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/readable.h"
#include "host/lua/interpreter/scheduler.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/vision/bind_vision.h"
#include "host/lua/vision/classes.h"

#include <filesystem>
#include <fstream>
#include <sstream>
#include <stdexcept>

namespace vitreo::lua {
namespace {

constexpr double kMaxTraining = 600;                  // s
constexpr std::uintmax_t kLargestModel = 64'000'000;  // bytes; one has half a million

const vision::ObjectModel& model_of(const Call& call) { return call.self<TrainedModel>().model; }

int train(Call& call) {
  auto images = std::make_shared<std::vector<vision::LabeledImage>>(labeled_option(call));
  auto made = std::make_shared<TrainedModel>();
  made->color = color_settings(call);
  const vision::ObjectViewSettings view = view_settings(call);
  return call.wait(work(
      call, "training",
      [=] { made->model = vision::ObjectModel::train(*images, made->color, view); },
      from_seconds(kMaxTraining),
      [made](Call& done) {
        push_handle(done.L, color_model_class(), made);
        return 1;
      }));
}

int load(Call& call) {
  const std::filesystem::path file = readable(call.context(), call.text(0));
  if (!std::filesystem::is_regular_file(file))
    throw std::invalid_argument("path: " + call.text(0) + " is no file");
  if (std::filesystem::file_size(file) > kLargestModel)
    throw std::invalid_argument("path: " + call.text(0) + " is too long for a model");
  std::ostringstream bytes;
  bytes << std::ifstream(file, std::ios::binary).rdbuf();
  auto made = std::make_shared<TrainedModel>();
  try {
    made->model = vision::ObjectModel::load(bytes.str());
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument("path: " + call.text(0) + ": " + error.what());
  }
  made->color.channels = made->model.color.channels();
  push_handle(call.L, color_model_class(), made);
  return 1;
}

int push_ranks(lua_State* L, const std::vector<vision::ChannelRank>& ranks) {
  lua_newtable(L);
  for (std::size_t i = 0; i < ranks.size(); ++i) {
    push_fields(L, {{"mean", ranks[i].quality.mean}, {"deviation", ranks[i].quality.deviation}});
    lua_pushstring(L, vision::name_of(ranks[i].channels).c_str());
    lua_setfield(L, -2, "channels");
    lua_rawseti(L, -2, static_cast<lua_Integer>(i + 1));
  }
  return 1;
}

int rank(Call& call) {
  auto images = std::make_shared<std::vector<vision::LabeledImage>>(labeled_option(call));
  auto ranks = std::make_shared<std::vector<vision::ChannelRank>>();
  const vision::ColorModelSettings settings = color_settings(call);
  return call.wait(work(
      call, "ranking", [=] { *ranks = vision::ColorModel::rank(*images, settings); },
      from_seconds(kMaxTraining), [ranks](Call& done) { return push_ranks(done.L, *ranks); }));
}

int save_model(Call& call) {
  const auto file = writable(call.context(), call.text(0));
  write_file(file, model_of(call).save());
  return call.result(file.string());
}

int model_channels(Call& call) {
  return call.result(vision::name_of(model_of(call).color.channels()));
}

int quality(Call& call) {
  const vision::Quality& quality = model_of(call).color.quality();
  lua_pushnumber(call.L, quality.mean);
  lua_pushnumber(call.L, quality.deviation);
  push_numbers(call.L, quality.of_image);
  return 3;
}

int thresholds(Call& call) {
  const auto &weighted = model_of(call).color.weighted_thresholds(),
             &flat = model_of(call).color.flat_thresholds();
  push_fields(call.L, {{"low", weighted.low},
                       {"high", weighted.high},
                       {"flat_low", flat.low},
                       {"flat_high", flat.high}});
  return 1;
}

int likelihood(Call& call) {
  const double red = call.number(0), green = call.number(1), blue = call.number(2);
  const std::size_t cell = vision::ColorModel::cell_of(
      static_cast<unsigned>(blue), static_cast<unsigned>(green), static_cast<unsigned>(red));
  return call.result(model_of(call).color.table()[cell] / vision::ColorModel::kScale);
}

int shape(Call& call) {
  const vision::ObjectModel& model = model_of(call);
  push_fields(call.L, {{"major_px", 2 * model.semi_axes_px.x()},
                       {"minor_px", 2 * model.semi_axes_px.y()},
                       {"modes", model.shape.modes()},
                       {"explained", model.shape.explained()}});
  push_numbers(call.L, {model.shape.eigenvalues().begin(),
                        model.shape.eigenvalues().begin() + model.shape.modes()});
  lua_setfield(call.L, -2, "eigenvalues");
  return 1;
}

int calibration(Call& call) {
  const vision::Calibration& rim = model_of(call).rim;
  push_fields(call.L, {{"major_px", 2 * rim.semi_axes_px.x()},
                       {"minor_px", 2 * rim.semi_axes_px.y()},
                       {"sigma_x_px", std::sqrt(rim.covariance(0, 0))},
                       {"sigma_y_px", std::sqrt(rim.covariance(1, 1))},
                       {"sigma_angle", std::sqrt(rim.covariance(4, 4))}});
  return 1;
}

int image_size(Call& call) {
  lua_pushinteger(call.L, model_of(call).image_size.width);
  lua_pushinteger(call.L, model_of(call).image_size.height);
  return 2;
}

}  // namespace

vision::ColorModelSettings color_settings(const Call& call) {
  vision::ColorModelSettings settings;
  if (const auto name = call.text_option("channels"))
    settings.channels = vision::channels_of(*name);
  if (const auto bins = call.number_option("bins")) settings.bins = static_cast<int>(*bins);
  if (const auto sigma = call.number_option("smoothing_bins")) settings.smoothing_bins = *sigma;
  if (const auto radius = call.number_option("neighborhood_px"))
    settings.neighborhood_px = static_cast<int>(*radius);
  settings.check();
  return settings;
}

std::vector<Argument> with_color_options(std::vector<Argument> options) {
  options.push_back(
      {.name = "channels",
       .type = Type::text,
       .optional = true,
       .help = "\"RGB\" (all three, as is), or a pair such as \"RG\", \"YV\", \"HS\", \"nRnG\""});
  options.push_back(
      number_option_row("bins", 4, 64, "of the histogram, along each channel (32)", Type::integer));
  options.push_back(number_option_row("smoothing_bins", 0, 8, "deviation of its smoothing (0.6)"));
  options.push_back(number_option_row("neighborhood_px", 1, 200,
                                      "how far around the object (8.1) looks (12)", Type::integer));
  return options;
}

std::vector<Binding> vision_model_rows() {
  const auto options = [](std::vector<Argument> rows) {
    return Argument{.name = "options", .type = Type::options, .options = std::move(rows)};
  };
  return {{"vision.color_model.train",
           {options(with_color_options({labeled_argument()}))},
           "color_model",
           "learns colors, shapes and the rim's calibration from images with masks (8.1, 8.2.2)",
           train},
          {"vision.color_model.rank",
           {options(with_color_options({labeled_argument()}))},
           "list of {channels, mean, deviation}",
           "the quality (8.1) of all eighteen pairs of channels, in the order of table 8.2",
           rank},
          {"vision.color_model.load",
           {{.name = "path", .type = Type::text, .help = "of what color_model:save wrote"}},
           "color_model",
           "reads a model",
           load}};
}

const Class& color_model_class() {
  const auto level = [](const char* name) {
    return Argument{.name = name, .type = Type::integer, .min = 0, .max = 255};
  };
  static const Class kind{
      "color_model",
      "what an object looks like; make one with vision.color_model.train",
      {{"save",
        {{.name = "name",
          .type = Type::text,
          .help = "a new file of the run's folder, such as \"robot.model\""}},
        "path",
        "keeps it in the run's folder",
        save_model},
       {"channels", {}, "string", "that it looks at", model_channels},
       {"quality",
        {},
        "mean, deviation, list",
        "(8.1) over the training images, -2 to 2; the list has each",
        quality},
       {"thresholds",
        {},
        "table",
        "low, high: of F, with wrong decisions weighed more than open ones; flat_low, flat_high: "
        "of (8.2) as it stands",
        thresholds},
       {"likelihood",
        {level("red"), level("green"), level("blue")},
        "number",
        "F: the logarithm of how much rather a color is the object's than the ground's",
        likelihood},
       {"shape",
        {},
        "table",
        "major_px, minor_px: mean full axes; modes, eigenvalues, explained: of the eigenshapes "
        "(8.3)",
        shape},
       {"calibration",
        {},
        "table",
        "major_px, minor_px: by how much too large axes are measured; sigma_x_px, sigma_y_px, "
        "sigma_angle: what light "
        "and shadow add to the scatter",
        calibration},
       {"image_size", {}, "width, height", "of the images that it is for", image_size}},
      {}};
  return kind;
}

}  // namespace vitreo::lua
