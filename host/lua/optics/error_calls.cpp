// SPDX-License-Identifier: Apache-2.0
#include "host/lua/optics/error_calls.h"

#include "host/lua/optics/localizer_calls.h"
#include "optics/analysis/field_errors.h"

#include <algorithm>
#include <stdexcept>
#include <string>

namespace vitreo::lua::error_calls {
namespace {

/// Of depth on the axis, by focus over the field, by pose over the field.
enum class Method { axis, field, pose };

using optics::BiometricMethod;
using optics::ErrorMeasure;

/// A word of a few; nothing when the option is absent.
template <class Value>
std::optional<Value> word_option(const Call& call, const std::string& name,
                                 const std::vector<std::pair<std::string, Value>>& words) {
  const auto text = call.text_option(name);
  if (!text) return std::nullopt;
  std::string known;
  for (const auto& [word, value] : words) {
    if (word == *text) return value;
    known += (known.empty() ? "" : " or ") + word;
  }
  throw std::invalid_argument(name + ": wants " + known + ", got " + *text);
}

const std::vector<std::pair<std::string, BiometricMethod>> kBiometric = {
    {"sensor_shift", BiometricMethod::sensor_shift},
    {"minimum_norm", BiometricMethod::minimum_norm}};
const std::vector<std::pair<std::string, ErrorMeasure>> kMeasures = {{"max", ErrorMeasure::max},
                                                                     {"mean", ErrorMeasure::mean}};

/// What the script gives takes the place of the default.
void take(const Call& call, const char* name, double& value) {
  value = call.number_option(name).value_or(value);
}
void take(const Call& call, const char* name, int& value) {
  if (const auto given = call.number_option(name)) value = static_cast<int>(*given);
}

/// Chapter 4's error on the axis: depth by the law (4.10) to (4.12) from traced foci.
MakeError axis_error_of(const Call& call) {
  optics::AxisErrorOptions options;
  options.calibrated = call.flag_option("calibrated");
  options.method = word_option(call, "calibration_method", kBiometric).value_or(options.method);
  take(call, "retinal_depth_error", options.retinal_depth_error);
  take(call, "depth_to", options.depth_to);
  take(call, "depths", options.depths);
  options.check();
  return [options](const optics::Prescription& believed) {
    return optics::axis_error(believed, optics::traced_focus(), options);
  };
}

/// The same over the field, by the thesis' isofocus and isopixel curves.
MakeError field_error_of(const Call& call) {
  optics::FieldErrorOptions options;
  options.calibrated = call.flag_option("calibrated");
  options.method = word_option(call, "calibration_method", kBiometric).value_or(options.method);
  options.measure = word_option(call, "measure", kMeasures).value_or(options.measure);
  take(call, "retinal_depth_error", options.retinal_depth_error);
  take(call, "focus_error", options.focus_error);
  take(call, "max_angle", options.max_angle);
  take(call, "depth_to", options.depth_to);
  take(call, "angles", options.angles);
  take(call, "depths", options.depths);
  options.check();
  return [options](const optics::Prescription& believed) {
    return optics::field_error(believed, options);
  };
}

/// The pose error knows outlines of spheroids only.
optics::Spheroid robot_option(const Call& call, const optics::Spheroid& usual) {
  optics::Spheroid robot = usual;
  if (call.push_option("robot")) {
    const optics::ObjectModel body =
        localizer_calls::body_at(OptionTable(call.L, lua_gettop(call.L)));
    if (!(body.ellipsoid() && body.round_about_z()))
      throw std::invalid_argument("robot: wants a spheroid");
    robot = {body.semi_axes.z(), body.semi_axes.x()};
  }
  lua_pop(call.L, 1);
  return robot;
}

/// Table 5.2: by pose, over the field.
MakeError pose_error_of(const Call& call) {
  optics::PoseErrorOptions options;
  options.microscope = microscope_option(call).value_or(options.microscope);
  options.robot = robot_option(call, options.robot);
  options.exact = call.flag_option("exact");
  options.calibrated = call.flag_option("calibrated");
  options.measure = word_option(call, "measure", kMeasures).value_or(options.measure);
  take(call, "retinal_depth_error", options.retinal_depth_error);
  take(call, "max_m", options.max_m);
  take(call, "max_angle", options.max_angle);
  take(call, "depth_from", options.depth_from);
  take(call, "depth_to", options.depth_to);
  take(call, "angles", options.angles);
  take(call, "depths", options.depths);
  options.check();
  return [options](const optics::Prescription& believed) {
    return optics::pose_error(believed, options);
  };
}

Argument flag_option(const char* name, const char* help) {
  return {.name = name, .type = Type::flag, .optional = true, .help = help};
}

/// Three at least: a mean over the field needs its middle and its ends.
Argument grid_option(const char* name, const char* help) {
  return {
      .name = name, .type = Type::integer, .optional = true, .min = 3, .max = 1000, .help = help};
}

Argument text_option(const char* name, const char* help) {
  return {.name = name, .type = Type::text, .optional = true, .help = help};
}

std::vector<Argument> field_options() {
  return {{.name = "max_angle",
           .type = Type::number,
           .unit = "rad",
           .optional = true,
           .min = 0.01,
           .max = 1.5,
           .help = "of the field, at the pupil's center (35 deg)"},
          grid_option("angles", "of the grid (8)"),
          text_option("measure", "max or mean over the field (max by focus, mean by pose)")};
}

/// The word that scripts say for it.
const char* word_of(Method method) {
  return method == Method::axis ? "axis" : method == Method::field ? "field" : "pose";
}

/// Which options each error knows. One list, read twice: for the row, where they stand together,
/// and by error_of, which refuses those of another method.
std::vector<Argument> options_of_method(Method method) {
  std::vector<Argument> options = {
      flag_option("calibrated", "on the eye's own retina (false)"),
      length_option("retinal_depth_error", 0, 0.1,
                    "of that calibration, the worse sign counts (0)"),
      length_option("depth_to", 1e-4, 1, "depths from the retina to here (8 mm)"),
      grid_option("depths", "of the grid")};
  if (method != Method::axis)
    for (Argument& one : field_options()) options.push_back(std::move(one));
  if (method != Method::pose)
    options.push_back(text_option("calibration_method", "sensor_shift (default), or minimum_norm"));
  if (method == Method::field)
    options.push_back(length_option("focus_error", 0, 0.1,
                                    "by which the sensor is misplaced, the worse sign (0)"));
  if (method == Method::pose) {
    Argument robot = localizer_calls::body_argument();
    robot.name = "robot";
    robot.optional = true;
    robot.help = "a spheroid (the sphere of 1 mm)";
    options.insert(options.end(),
                   {microscope_argument(), robot,
                    flag_option("exact", "both chains' own lines (single viewpoints)"),
                    length_option("max_m", 1e-4, 1, "of the aerial image (9.9 mm)"),
                    length_option("depth_from", 0, 1, "depths from here (1 mm)")});
  }
  return options;
}

}  // namespace

/// Without repeats: a name that several methods know has one meaning.
std::vector<Argument> options_of_all() {
  std::vector<Argument> all = {text_option(
      "error", "axis: depth by focus on the axis (default); field: by focus; pose: by pose")};
  for (const Method method : {Method::axis, Method::field, Method::pose})
    for (Argument& one : options_of_method(method))
      if (std::none_of(all.begin(), all.end(),
                       [&](const Argument& had) { return had.name == one.name; }))
        all.push_back(std::move(one));
  return all;
}

/// An option of another method is refused: to ignore it would let a script believe that it counts.
MakeError error_of(const Call& call) {
  const Method method =
      word_option<Method>(
          call, "error", {{"axis", Method::axis}, {"field", Method::field}, {"pose", Method::pose}})
          .value_or(Method::axis);
  const std::vector<Argument> own = options_of_method(method);
  for (const Argument& one : options_of_all()) {
    const bool given = call.push_option(one.name);
    lua_pop(call.L, 1);
    if (given && one.name != "error" &&
        std::none_of(own.begin(), own.end(),
                     [&](const Argument& known) { return known.name == one.name; }))
      throw std::invalid_argument(one.name + ": the error by " + word_of(method) +
                                  " does not know it");
  }
  switch (method) {
    case Method::axis:
      return axis_error_of(call);
    case Method::field:
      return field_error_of(call);
    default:
      return pose_error_of(call);
  }
}

}  // namespace vitreo::lua::error_calls
