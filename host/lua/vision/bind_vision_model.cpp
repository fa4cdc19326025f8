// Bindings of color_model: colors and shapes learnt from images with masks.
// SPDX-License-Identifier: Apache-2.0
#include "host/files/run_folder.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/readable.h"
#include "host/lua/interpreter/scheduler.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/interpreter/work.h"
#include "host/lua/vision/bind_vision.h"
#include "host/lua/vision/classes.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <stdexcept>

namespace vitreo::lua {
namespace {

constexpr double kMaxTraining = 600;                  // s
constexpr std::uintmax_t kLargestModel = 64'000'000;  // bytes; one has half a million

const vision::ObjectModel& model_of(const Call& call) { return call.self<TrainedModel>().model; }

/// A file's bytes, which `option` names. Throws std::invalid_argument naming both.
std::string bytes_of(const Call& call, const std::string& option, const std::string& name,
                     std::uintmax_t most) {
  const std::filesystem::path file = readable(call.context(), name);
  if (!std::filesystem::is_regular_file(file))
    throw std::invalid_argument(option + ": " + name + " is no file");
  if (std::filesystem::file_size(file) > most)
    throw std::invalid_argument(option + ": " + name + " is too long for a model");
  std::ostringstream bytes;
  bytes << std::ifstream(file, std::ios::binary).rdbuf();
  return bytes.str();
}

/// Some seconds of work on a task of its own, on copies of the images' headers: their pixels are
/// shared, and nothing changes them.
int train(const Call& call) {
  auto images = std::make_shared<std::vector<vision::LabeledImage>>(labeled_option(call));
  auto made = std::make_shared<TrainedModel>();
  made->color = color_settings(call);
  if (const auto share = call.number_option("mixed")) made->color.mixed = *share;
  const vision::ObjectViewSettings view = view_settings(call);
  const auto network_file = call.text_option("network");
  const std::string network =
      network_file ? bytes_of(call, "network", *network_file, kLargestModel) : std::string();
  const std::vector<Eigen::Vector2d> tips = tips_option(call);
  const bool pointed =
      std::any_of(tips.begin(), tips.end(), [](const auto& tip) { return tip.allFinite(); });
  return call.wait(work(
      call, "training",
      [=] {
        made->model = vision::ObjectModel::train(*images, made->color, view, network);
        if (pointed) made->model.head = vision::HeadModel::train(*images, tips);
      },
      from_seconds(kMaxTraining),
      [made](Call& done) {
        push_handle(done.L, color_model_class(), made);
        return 1;
      }));
}

/// What color_model:save wrote, and nothing else (ObjectModel::load). Of the training's settings
/// the file has the channels alone, from which its table was compiled.
int load(const Call& call, const std::string& name) {
  const std::string bytes = bytes_of(call, "file", name, kLargestModel);
  auto made = std::make_shared<TrainedModel>();
  try {
    made->model = vision::ObjectModel::load(bytes);
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument("file: " + name + ": " + error.what());
  }
  made->color.channels = made->model.color.channels();
  push_handle(call.L, color_model_class(), made);
  return 1;
}

/// Of vision.color_model beside `file`.
std::vector<Argument> training_options() {
  std::vector<Argument> options = with_color_options({labeled_argument()});
  options.push_back(number_option_row(
      "mixed", 0, 1,
      "share of the colors that defocus would mix at the rim (0); 0.1 follows one out of focus"));
  options.push_back({.name = "network",
                     .type = Type::text,
                     .optional = true,
                     .help = "learned evidence beside the colors: an ONNX file, such as "
                             "\"networks/evidence.onnx\""});
  return options;
}

/// A model from a file has its training behind it: options of training beside it are refused.
int color_model(Call& call) {
  const auto file = call.text_option("file");
  if (!file) return train(call);
  for (const Argument& option : training_options()) {
    if (option_given(call, option.name))
      throw std::invalid_argument(option.name +
                                  ": is for training; a model from a file has its own");
  }
  return load(call, *file);
}

/// In the order of table 8.2, not by quality: the script compares or sorts.
int push_ranks(const Call& call, const std::vector<vision::ChannelRank>& ranks) {
  return push_result_list(call, ranks.size(), [&ranks](ResultTable& entry, std::size_t i) {
    entry.text("channels", vision::name_of(ranks[i].channels))
        .number("mean", ranks[i].quality.mean)
        .number("deviation", ranks[i].quality.deviation);
  });
}

/// All eighteen pairs of channels on the same images, as table 8.2.
int rank_channels(Call& call) {
  auto images = std::make_shared<std::vector<vision::LabeledImage>>(labeled_option(call));
  auto ranks = std::make_shared<std::vector<vision::ChannelRank>>();
  const vision::ColorModelSettings settings = color_settings(call);
  return call.wait(work(
      call, "ranking", [=] { *ranks = vision::ColorModel::rank(*images, settings); },
      from_seconds(kMaxTraining), [ranks](Call& done) { return push_ranks(done, *ranks); }));
}

/// Into the run's folder only, under a new name: a model is part of the run's record.
int save_model(Call& call) {
  const auto file = writable(call.context(), call.text(0));
  write_file(file, model_of(call).save());
  return call.result(file.string());
}

/// Of each image too: one bad mask shows as one bad number.
void set_quality(ResultTable& table, const vision::Quality& quality) {
  table.number("mean", quality.mean)
      .number("deviation", quality.deviation)
      .numbers("of_images", quality.of_image);
}

/// Two readings of (8.2): weighted, which trackers use, and as it stands (vision/color_model.h).
void set_thresholds(ResultTable& table, const vision::ObjectModel& model) {
  const vision::Thresholds& flat = model.color.flat_thresholds();
  table.number("low", model.thresholds().low)
      .number("high", model.thresholds().high)
      .number("flat_low", flat.low)
      .number("flat_high", flat.high);
}

/// Full axes; eigenvalues only of the modes that are kept.
void set_shape(ResultTable& table, const vision::ObjectModel& model) {
  const auto& eigenvalues = model.shape.eigenvalues();
  table.number("major_px", 2 * model.semi_axes_px.x())
      .number("minor_px", 2 * model.semi_axes_px.y())
      .number("modes", model.shape.modes())
      .number("explained", model.shape.explained())
      .numbers("eigenvalues", {eigenvalues.begin(), eigenvalues.begin() + model.shape.modes()});
}

/// The bias that trackers take off: measured less true full axes, over the training images; and
/// what remains for the rim as a whole, of which x, y and angle are entries 0, 1 and 4.
void set_calibration(ResultTable& table, const vision::Calibration& rim) {
  table.number("major_px", 2 * rim.semi_axes_px.x())
      .number("minor_px", 2 * rim.semi_axes_px.y())
      .number("sigma_x_px", std::sqrt(rim.covariance(0, 0)))
      .number("sigma_y_px", std::sqrt(rim.covariance(1, 1)))
      .number("sigma_angle", std::sqrt(rim.covariance(4, 4)), "rad");
}

/// What a person looks at before believing a model: how well its colors part object and ground,
/// where it decides, what shapes it saw, what bias it takes off.
int model_info(Call& call) {
  const vision::ObjectModel& model = model_of(call);
  ResultTable(call)
      .text("channels", vision::name_of(model.color.channels()))
      .integer("network_bytes", static_cast<std::int64_t>(model.network.size()))
      .integer("width_px", model.image_size.width)
      .integer("height_px", model.image_size.height)
      .table("quality", [&](ResultTable& made) { set_quality(made, model.color.quality()); })
      .table("thresholds", [&](ResultTable& made) { set_thresholds(made, model); })
      .table("shape", [&](ResultTable& made) { set_shape(made, model); })
      .table("calibration", [&](ResultTable& made) { set_calibration(made, model.rim); });
  return 1;
}

Returned model_fields() {
  return {"table",
          {{"channels", "", "that it looks at"},
           {"network_bytes", "", "of its learned evidence; 0: the colors alone"},
           {"width_px", "", "of the images that it is for"},
           {"height_px", "", ""},
           {"quality",
            "",
            "(8.1) over the training images, -2 to 2",
            {{"mean", "", ""}, {"deviation", "", ""}, {"of_images", "", "each"}}},
           {"thresholds",
            "",
            "of F, with wrong decisions weighed more than open ones",
            {{"low", "", ""},
             {"high", "", ""},
             {"flat_low", "", "of (8.2) as it stands"},
             {"flat_high", "", "of (8.2) as it stands"}}},
           {"shape",
            "",
            "mean full axes, and the eigenshapes (8.3)",
            {{"major_px", "", ""},
             {"minor_px", "", ""},
             {"modes", "", "how many"},
             {"eigenvalues", "", ""},
             {"explained", "", "part of the variance"}}},
           {"calibration",
            "",
            "by how much too large axes are measured, and what light and shadow add to the scatter",
            {{"major_px", "", ""},
             {"minor_px", "", ""},
             {"sigma_x_px", "", ""},
             {"sigma_y_px", "", ""},
             {"sigma_angle", "rad", ""}}}}};
}

}  // namespace

/// check() judges them here, before a long training begins.
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

/// Of training and of ranking alike.
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
  Argument labeled = labeled_argument();
  std::vector<Argument> training = training_options();
  training[0].optional = true;
  training[0].help = "to learn from: " + labeled.help;
  training.push_back({.name = "file",
                      .type = Type::text,
                      .optional = true,
                      .help = "instead: what color_model:save wrote"});
  return {
      {"vision.color_model",
       {options_of(training)},
       "color_model",
       "learns colors, shapes and the rim's calibration from images with masks (8.1, 8.2.2), or "
       "reads a model",
       color_model,
       "vision.color_model { images = training, channels = \"RG\" }"},
      {"vision.rank_channels",
       {options_of(with_color_options({labeled}))},
       {"list of tables",
        {{"channels", "", "a pair"}, {"mean", "", "quality"}, {"deviation", "", ""}}},
       "the quality (8.1) of all eighteen pairs of channels, in the order of table 8.2",
       rank_channels,
       "vision.rank_channels { images = training }"}};
}

const Class& color_model_class() {
  static const Class kind{"color_model",
                          "what an object looks like; make one with vision.color_model",
                          {{"save",
                            {{.name = "name",
                              .type = Type::text,
                              .help = "a new file of the run's folder, such as \"robot.model\""}},
                            "path",
                            "keeps it in the run's folder",
                            save_model,
                            "color_model:save(\"robot.model\")"},
                           {"info",
                            {},
                            model_fields(),
                            "channels, quality, thresholds, shape and calibration",
                            model_info,
                            "color_model:info()"}}};
  return kind;
}

}  // namespace vitreo::lua
