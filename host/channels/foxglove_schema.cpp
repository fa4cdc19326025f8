// SPDX-License-Identifier: Apache-2.0
#include "host/channels/foxglove_schema.h"

#include <algorithm>
#include <map>
#include <stdexcept>
#include <string_view>
#include <utility>
#include <vector>

namespace vitreo {
namespace {

using nlohmann::json;

/// Of a field: a JSON type, "time", "duration", "bytes", "count", a row of kChoices or of kShapes;
/// "[]" before it makes a list, "?" before that a field that may be missing.
using Fields = std::vector<std::pair<const char*, const char*>>;

constexpr const char* kNumber = "number";
constexpr const char* kText = "string";
constexpr const char* kFlag = "boolean";
constexpr const char* kCount = "count";

/// Names of the numbers of a field, in ascending order from the first.
struct Choice {
  int first;
  std::vector<const char*> names;
};

/// Enumerations of the schemas, by the numbers that @foxglove/schemas gives them.
const std::map<std::string, Choice, std::less<>> kChoices{
    {"LogLevel", {0, {"UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL"}}},
    {"LineType", {0, {"LINE_STRIP", "LINE_LOOP", "LINE_LIST"}}},
    {"PointsAnnotationType", {0, {"UNKNOWN", "POINTS", "LINE_LOOP", "LINE_STRIP", "LINE_LIST"}}},
    {"SceneEntityDeletionType", {0, {"MATCHING_ID", "ALL"}}}};

/// Fields in the order of @foxglove/schemas (npm), with which a test compares the schemas made of
/// them; "bytes" are base64 in JSON.
const std::map<std::string, Fields, std::less<>> kShapes{
    {"Vector3", {{"x", kNumber}, {"y", kNumber}, {"z", kNumber}}},
    {"Point3", {{"x", kNumber}, {"y", kNumber}, {"z", kNumber}}},
    {"Point2", {{"x", kNumber}, {"y", kNumber}}},
    {"Quaternion", {{"x", kNumber}, {"y", kNumber}, {"z", kNumber}, {"w", kNumber}}},
    {"Color", {{"r", kNumber}, {"g", kNumber}, {"b", kNumber}, {"a", kNumber}}},
    {"KeyValuePair", {{"key", kText}, {"value", kText}}},
    {"Pose", {{"position", "Vector3"}, {"orientation", "Quaternion"}}},
    {"PoseInFrame", {{"timestamp", "time"}, {"frame_id", kText}, {"pose", "Pose"}}},
    {"FrameTransform",
     {{"timestamp", "time"},
      {"parent_frame_id", kText},
      {"child_frame_id", kText},
      {"translation", "Vector3"},
      {"rotation", "Quaternion"}}},
    {"FrameTransforms", {{"transforms", "[]FrameTransform"}}},
    {"CompressedImage",
     {{"timestamp", "time"}, {"frame_id", kText}, {"data", "bytes"}, {"format", kText}}},
    {"RawImage",
     {{"timestamp", "time"},
      {"frame_id", kText},
      {"width", kCount},
      {"height", kCount},
      {"encoding", kText},
      {"step", kCount},
      {"data", "bytes"}}},
    {"Log",
     {{"timestamp", "time"},
      {"level", "LogLevel"},
      {"message", kText},
      {"name", kText},
      {"file", kText},
      {"line", kCount}}},
    {"CircleAnnotation",
     {{"timestamp", "time"},
      {"position", "Point2"},
      {"diameter", kNumber},
      {"thickness", kNumber},
      {"fill_color", "Color"},
      {"outline_color", "Color"},
      {"metadata", "?[]KeyValuePair"}}},
    {"PointsAnnotation",
     {{"timestamp", "time"},
      {"type", "PointsAnnotationType"},
      {"points", "[]Point2"},
      {"outline_color", "Color"},
      {"outline_colors", "[]Color"},
      {"fill_color", "Color"},
      {"thickness", kNumber},
      {"metadata", "?[]KeyValuePair"}}},
    {"TextAnnotation",
     {{"timestamp", "time"},
      {"position", "Point2"},
      {"text", kText},
      {"font_size", kNumber},
      {"text_color", "Color"},
      {"background_color", "Color"},
      {"metadata", "?[]KeyValuePair"}}},
    {"ImageAnnotations",
     {{"timestamp", "?time"},
      {"circles", "[]CircleAnnotation"},
      {"points", "[]PointsAnnotation"},
      {"texts", "[]TextAnnotation"},
      {"metadata", "?[]KeyValuePair"}}},
    {"ArrowPrimitive",
     {{"pose", "Pose"},
      {"shaft_length", kNumber},
      {"shaft_diameter", kNumber},
      {"head_length", kNumber},
      {"head_diameter", kNumber},
      {"color", "Color"}}},
    {"CubePrimitive", {{"pose", "Pose"}, {"size", "Vector3"}, {"color", "Color"}}},
    {"SpherePrimitive", {{"pose", "Pose"}, {"size", "Vector3"}, {"color", "Color"}}},
    {"CylinderPrimitive",
     {{"pose", "Pose"},
      {"size", "Vector3"},
      {"bottom_scale", kNumber},
      {"top_scale", kNumber},
      {"color", "Color"}}},
    {"LinePrimitive",
     {{"type", "LineType"},
      {"pose", "Pose"},
      {"thickness", kNumber},
      {"scale_invariant", kFlag},
      {"points", "[]Point3"},
      {"color", "Color"},
      {"colors", "[]Color"},
      {"indices", "[]count"}}},
    {"TriangleListPrimitive",
     {{"pose", "Pose"},
      {"points", "[]Point3"},
      {"color", "Color"},
      {"colors", "[]Color"},
      {"indices", "[]count"}}},
    {"TextPrimitive",
     {{"pose", "Pose"},
      {"billboard", kFlag},
      {"font_size", kNumber},
      {"scale_invariant", kFlag},
      {"color", "Color"},
      {"text", kText}}},
    {"ModelPrimitive",
     {{"pose", "Pose"},
      {"scale", "Vector3"},
      {"color", "Color"},
      {"override_color", kFlag},
      {"url", kText},
      {"media_type", kText},
      {"data", "bytes"}}},
    {"SceneEntityDeletion",
     {{"timestamp", "time"}, {"type", "SceneEntityDeletionType"}, {"id", kText}}},
    {"SceneEntity",
     {{"timestamp", "time"},
      {"frame_id", kText},
      {"id", kText},
      {"lifetime", "duration"},
      {"frame_locked", kFlag},
      {"metadata", "[]KeyValuePair"},
      {"arrows", "[]ArrowPrimitive"},
      {"cubes", "[]CubePrimitive"},
      {"spheres", "[]SpherePrimitive"},
      {"cylinders", "[]CylinderPrimitive"},
      {"lines", "[]LinePrimitive"},
      {"triangles", "[]TriangleListPrimitive"},
      {"texts", "[]TextPrimitive"},
      {"models", "[]ModelPrimitive"}}},
    {"SceneUpdate", {{"deletions", "[]SceneEntityDeletion"}, {"entities", "[]SceneEntity"}}}};

/// {"sec", "nsec"} of a time since 1970, or of a duration.
json moment(const char* title, bool since_1970) {
  // A duration may be negative; a time is not, as readers take it for unsigned.
  json sec = {{"type", "integer"}};
  if (since_1970) sec["minimum"] = 0;
  const json nsec = {{"type", "integer"}, {"minimum", 0}, {"maximum", 999999999}};
  return {{"type", "object"}, {"title", title}, {"properties", {{"sec", sec}, {"nsec", nsec}}}};
}

json schema_of(std::string_view type) {
  if (type.starts_with("[]")) return {{"type", "array"}, {"items", schema_of(type.substr(2))}};
  if (type == "time") return moment("time", true);
  if (type == "duration") return moment("duration", false);
  if (type == "bytes") return {{"type", "string"}, {"contentEncoding", "base64"}};
  // uint32 in the schemas' source, which JSON Schema has no word for.
  if (type == kCount) return {{"type", "integer"}, {"minimum", 0}};
  const std::string title = "foxglove." + std::string(type);
  if (const auto found = kChoices.find(type); found != kChoices.end()) {
    // oneOf with const and title: readers show the title of the number that was sent.
    json alternatives = json::array();
    int number = found->second.first;
    for (const char* name : found->second.names)
      alternatives.push_back({{"title", name}, {"const", number++}});
    return {{"title", title}, {"oneOf", alternatives}};
  }
  const auto shape = kShapes.find(type);
  // A plain type of JSON: "number", "string", "boolean".
  if (shape == kShapes.end()) return {{"type", std::string(type)}};
  json properties = json::object();
  json required = json::array();
  // All are required but those with a question mark: some readers refuse a message that lacks one.
  for (const auto& [name, kind] : shape->second) {
    const bool optional = *kind == '?';
    properties[name] = schema_of(optional ? kind + 1 : kind);
    if (!optional) required.push_back(name);
  }
  return {{"title", title}, {"type", "object"}, {"properties", properties}, {"required", required}};
}

}  // namespace

json foxglove_schema(const std::string& name) {
  if (kShapes.count(name) == 0)
    throw std::invalid_argument("foxglove." + name + ": is not in the table of schemas");
  return schema_of(name);
}

std::uint64_t UtcClock::ns(Time time) const {
  // Unsigned in MCAP and in the protocol: a run with a zero before 1970 would wrap around.
  return static_cast<std::uint64_t>(std::max<std::int64_t>(0, t0_ + time.count()));
}

json UtcClock::stamp(Time time) const {
  constexpr std::uint64_t kSecond = 1000000000;
  return {{"sec", ns(time) / kSecond}, {"nsec", ns(time) % kSecond}};
}

}  // namespace vitreo
