// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/genicam/features.h"

#include "devices/time/error.h"

#include <charconv>
#include <cmath>
#include <cstdint>
#include <utility>

namespace vitreo::genicam {
namespace {

/// The whole text is one number; else nothing.
template <class Number>
std::optional<Number> number_of(const std::string& text) {
  Number number{};
  const char* const end = text.data() + text.size();
  const auto read = std::from_chars(text.data(), end, number);
  if (read.ec != std::errc{} || read.ptr != end) return std::nullopt;
  return number;
}

std::optional<bool> flag_of(const std::string& text) {
  if (text == "true" || text == "1" || text == "On") return true;
  if (text == "false" || text == "0" || text == "Off") return false;
  return std::nullopt;
}

}  // namespace

Features::Features(ArvCamera* camera, std::string name)
    : camera_(camera), device_(arv_camera_get_device(camera)), name_(std::move(name)) {
  arv_device_set_range_check_policy(device_, ARV_RANGE_CHECK_POLICY_ENABLE);
  arv_device_set_access_check_policy(device_, ARV_ACCESS_CHECK_POLICY_ENABLE);
}

void Features::fail(const std::string& feature, const std::string& why) const {
  throw DeviceError(DeviceErrorKind::refused, name_, "feature " + feature + ": " + why);
}

ArvGcNode* Features::node(const std::string& feature) const {
  ArvGcNode* const found = arv_device_get_feature(device_, feature.c_str());
  return ARV_IS_GC_FEATURE_NODE(found) ? found : nullptr;
}

bool Features::available(const std::string& feature) const {
  GError* error = nullptr;
  const bool has = arv_device_is_feature_available(device_, feature.c_str(), &error) != FALSE;
  if (error != nullptr) g_error_free(error);
  return has && node(feature) != nullptr;
}

std::string Features::value(const std::string& feature) const {
  ArvGcNode* const found = node(feature);
  if (found == nullptr) fail(feature, "this camera has none of that name");
  if (ARV_IS_GC_COMMAND(found)) fail(feature, "is a command and has no value");
  GError* error = nullptr;
  const char* const text =
      arv_gc_feature_node_get_value_as_string(ARV_GC_FEATURE_NODE(found), &error);
  if (error != nullptr) fail(feature, text_and_free(error));
  if (text == nullptr) fail(feature, "is neither a number nor a word");
  return text;
}

std::optional<std::string> Features::value_of(const std::string& feature) const {
  if (!available(feature)) return std::nullopt;
  try {
    return value(feature);
  } catch (const DeviceError&) {
    return std::nullopt;  // one that can be written only
  }
}

// An enumeration is an integer and a string to Aravis too, a flag an integer: the narrower kinds
// come first.
void Features::write(ArvGcNode* found, const std::string& feature, const std::string& value,
                     GError** error) const {
  const char* const name = feature.c_str();
  if (ARV_IS_GC_COMMAND(found)) {
    if (!value.empty()) fail(feature, "is a command and takes no value");
    return arv_device_execute_command(device_, name, error);
  }
  if (ARV_IS_GC_ENUMERATION(found))
    return arv_device_set_string_feature_value(device_, name, value.c_str(), error);
  if (ARV_IS_GC_BOOLEAN(found)) {
    const auto flag = flag_of(value);
    if (!flag) fail(feature, "'" + value + "' is neither true nor false");
    return arv_device_set_boolean_feature_value(device_, name, *flag ? TRUE : FALSE, error);
  }
  if (ARV_IS_GC_FLOAT(found)) {
    const auto number = number_of<double>(value);
    if (!number || !std::isfinite(*number)) fail(feature, "'" + value + "' is not a number");
    return arv_device_set_float_feature_value(device_, name, *number, error);
  }
  if (ARV_IS_GC_INTEGER(found)) {
    const auto number = number_of<std::int64_t>(value);
    if (!number) fail(feature, "'" + value + "' is not a whole number");
    return arv_device_set_integer_feature_value(device_, name, *number, error);
  }
  arv_device_set_string_feature_value(device_, name, value.c_str(), error);
}

std::string Features::set(const std::string& feature, const std::string& value) const {
  ArvGcNode* const found = node(feature);
  if (found == nullptr) fail(feature, "this camera has none of that name");
  GError* error = nullptr;
  write(found, feature, value, &error);
  if (error != nullptr) fail(feature, text_and_free(error));
  if (ARV_IS_GC_COMMAND(found)) return "";
  return value_of(feature).value_or(value);
}

void Features::set_where_available(const std::string& feature, const std::string& value) const {
  if (available(feature)) set(feature, value);
}

}  // namespace vitreo::genicam
