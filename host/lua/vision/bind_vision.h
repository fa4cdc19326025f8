// Shared parts of the bindings of the vision library.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/tables.h"
#include "vision/color_model.h"
#include "vision/color_tracker.h"
#include "vision/ellipse.h"

#include <opencv2/core/mat.hpp>

#include <optional>
#include <string>
#include <vector>

namespace vitreo::lua {

/// What a handle `image` holds: CV_8UC1 or CV_8UC3 (BGR). Nothing changes its pixels once it is
/// made.
struct Image {
  cv::Mat pixels;
};
/// Shares the pixels. Counts their bytes: Lua sees only small handles, and would let gigabytes lie.
/// Throws std::runtime_error when the script's living images would exceed 512 MB.
void push_image(lua_State* L, const cv::Mat& pixels);

/// What a handle `color_model` holds: all that a tracker must know.
struct TrainedModel {
  vision::ObjectModel model;
  vision::ColorModelSettings color;
};

/// The fields of each track of tracker:update.
std::vector<ResultField> track_fields();
void set_track(ResultTable& table, const vision::Track& track);
/// {x_px, y_px, major_px, minor_px, angle}, full axes. Throws std::invalid_argument naming `name`
/// and the key.
vision::Ellipse ellipse_at(lua_State* L, int index, const std::string& name);
/// {x_px, y_px, major_px, minor_px, angle} as fields of a result.
std::vector<ResultField> ellipse_fields(bool optional = false);
void set_ellipse(ResultTable& table, const vision::Ellipse& ellipse);
/// Names as a list, on top of the stack.
void push_names(lua_State* L, const std::vector<std::string>& names);

/// The option `images`: a list of {image = , mask = }.
Argument labeled_argument();
std::vector<vision::LabeledImage> labeled_option(const Call& call);
/// `tip` of each of them, {x_px, y_px}, or NaN where it has none.
std::vector<Eigen::Vector2d> tips_option(const Call& call);
/// The option `images`: a list of images.
std::vector<cv::Mat> images_option(const Call& call);
/// The option `models`: a list of color_models, which the script holds meanwhile.
std::vector<const TrainedModel*> models_option(const Call& call);

vision::ColorModelSettings color_settings(const Call& call);
std::vector<Argument> with_color_options(std::vector<Argument> options);
/// Options of the view of an object in a frame: shape_prior, refine, thresholds, gate_px.
vision::ObjectViewSettings view_settings(const Call& call);
std::vector<Argument> view_options();

/// Whether the call has the option, whatever it says.
bool option_given(const Call& call, const std::string& name);
Argument flag_option_row(const char* name, const char* help);
Argument number_option_row(const char* name, double min, double max, const char* help,
                           Type type = Type::number);
Argument handle_row(const char* name, const char* kind, const char* help, bool optional = false);

std::vector<Binding> vision_image_rows();
std::vector<Binding> vision_model_rows();
std::vector<Binding> vision_tracker_rows();
std::vector<Binding> vision_background_rows();
std::vector<Binding> vision_focus_rows();
/// A method of image.
Binding focus_row();
std::vector<Binding> vision_mosaic_rows();
std::vector<Binding> vision_retina_rows();

}  // namespace vitreo::lua
