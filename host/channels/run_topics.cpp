// SPDX-License-Identifier: Apache-2.0
#include "host/channels/run_topics.h"

#include "host/text/markup.h"

#include <opencv2/imgcodecs.hpp>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <numbers>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

using nlohmann::json;

constexpr int kJpegQuality = 80;  // as the live view's page has it

Topic foxglove_topic(const std::string& name, const std::string& schema) {
  return {name, "foxglove." + schema, foxglove_schema(schema)};
}

/// Number of a stream's channel; -1: it has none of that name.
int channel_of(const StreamInfo& stream, const std::string& name) {
  const auto found = std::find_if(stream.channels.begin(), stream.channels.end(),
                                  [&](const Channel& channel) { return channel.name == name; });
  return found == stream.channels.end() ? -1 : static_cast<int>(found - stream.channels.begin());
}

/// Three channels that are a vector, where the stream has all of them.
class VectorColumns {
 public:
  VectorColumns(const StreamInfo& stream, const std::string& x, const std::string& y,
                const std::string& z)
      : columns_{channel_of(stream, x), channel_of(stream, y), channel_of(stream, z)} {}
  bool there() const { return columns_.minCoeff() >= 0; }
  /// Nothing where a number is missing.
  std::optional<Eigen::Vector3d> of(std::span<const double> row) const {
    if (!there()) return {};
    Eigen::Vector3d v;
    for (int i = 0; i < 3; ++i) v[i] = row[static_cast<std::size_t>(columns_[i])];
    return v.allFinite() ? std::optional(v) : std::nullopt;
  }

 private:
  Eigen::Vector3i columns_;
};

VectorColumns columns_of(const StreamInfo& stream, const std::string& prefix) {
  return {stream, prefix + "x", prefix + "y", prefix + "z"};
}

// JSON Schema has no units: they stand in the descriptions, in brackets as in tables.
std::string description_of(const Channel& channel) {
  return "[" + (channel.unit.empty() ? "1" : channel.unit) + "]" +
         (channel.help.empty() ? "" : " " + channel.help) +
         (channel.axes.empty() ? "" : "; axes: " + channel.axes);
}

json schema_of(const StreamInfo& stream) {
  json properties = json::object();
  for (const Channel& channel : stream.channels)
    properties[channel.name] = {{"type", "number"}, {"description", description_of(channel)}};
  return {{"type", "object"},
          {"title", "vitreo." + stream.name},
          {"description", stream.source + (stream.clock.empty() ? "" : "; times: " + stream.clock)},
          {"properties", properties}};
}

// What is not finite is left out: JSON has no NaN, and readers refuse a schema that allows null.
std::string numbers_text(const StreamInfo& stream, std::span<const double> row) {
  json message = json::object();
  for (std::size_t i = 0; i < stream.channels.size(); ++i)
    if (std::isfinite(row[i])) message[stream.channels[i].name] = row[i];
  return json_text(message);
}

/// 3: warning, 4: error, 2: information (foxglove.LogLevel). An alarm's text begins with its
/// priority (alarm_text()).
int log_level(const std::string& kind, const std::string& text) {
  if (kind == "error" || kind == "unsafe" || kind == "interlock") return 4;
  if (kind != "alarm") return 2;
  return text.starts_with(to_string(AlarmPriority::high)) ? 4 : 3;
}

/// The tracked ellipse as a closed line. Foxglove's pixels begin at the corner of the first one,
/// ours in its middle.
struct EllipseColumns {
  explicit EllipseColumns(const StreamInfo& stream)
      : u(channel_of(stream, "u_px")),
        v(channel_of(stream, "v_px")),
        major(channel_of(stream, "semi_major_px")),
        minor(channel_of(stream, "semi_minor_px")),
        angle(channel_of(stream, "angle")) {}
  bool there() const { return std::min({u, v, major, minor, angle}) >= 0; }
  std::optional<json> outline(std::span<const double> row) const {
    constexpr int kPoints = 36;
    const auto at = [&](int column) { return row[static_cast<std::size_t>(column)]; };
    json points = json::array();
    for (int i = 0; i < kPoints; ++i) {
      const double t = i * 2 * std::numbers::pi / kPoints;
      const double along = at(major) * std::cos(t);
      const double across = at(minor) * std::sin(t);
      // `angle` in rad, from the direction of u towards that of v, which goes down.
      const double x = at(u) + along * std::cos(at(angle)) - across * std::sin(at(angle)) + 0.5;
      const double y = at(v) + along * std::sin(at(angle)) + across * std::cos(at(angle)) + 0.5;
      if (!std::isfinite(x) || !std::isfinite(y)) return {};
      points.push_back({{"x", x}, {"y", y}});
    }
    return points;
  }
  int u, v, major, minor, angle;
};

/// foxglove.ImageAnnotations; without an outline the old one is taken away by empty lists.
std::string annotations_text(const json& stamp, const std::optional<json>& outline) {
  json message = {{"circles", json::array()}, {"points", json::array()}, {"texts", json::array()}};
  constexpr int kLoop = 2;  // LINE_LOOP
  if (outline)
    message["points"].push_back({{"timestamp", stamp},
                                 {"type", kLoop},
                                 {"points", *outline},
                                 {"outline_color", color_json(0.2, 1, 0.4, 1)},
                                 {"outline_colors", json::array()},
                                 {"fill_color", color_json(0, 0, 0, 0)},
                                 {"thickness", 2.0}});
  return json_text(message);
}

/// "protocols/drift.lua:12" as file and line; a text that begins with none: "" and 0.
std::pair<std::string, int> file_and_line(const std::string& text) {
  const std::string place = script_line(text);
  const std::size_t colon = place.rfind(':');
  if (colon == std::string::npos) return {"", 0};
  return {place.substr(0, colon), std::atoi(place.c_str() + colon + 1)};
}

}  // namespace

std::string json_text(const json& json) {
  return json.dump(-1, ' ', false, json::error_handler_t::replace);
}

RunTopics::RunTopics(const RunStart& start, std::int64_t t0_utc_ns)
    : clock_(t0_utc_ns),
      scene_(std::make_shared<const RunScene>(
          start.rig.is_object() ? start.rig.value("geometry", json()) : json(), clock_)) {}

std::vector<RowTopic> RunTopics::of_stream(const StreamInfo& stream) const {
  std::vector<RowTopic> topics{
      {{"/" + stream.name, "vitreo." + stream.name, schema_of(stream)},
       [stream](Time, std::span<const double> row) { return numbers_text(stream, row); }}};
  if (stream.name == "servo")
    for (RowTopic& one : of_servo(stream)) topics.push_back(std::move(one));
  // A pose beside the measured one, to be compared with it.
  if (stream.name == "truth" || stream.name == "estimate")
    if (auto pose = of_pose(stream, "/" + stream.name + "/pose", "")) topics.push_back(*pose);
  return topics;
}

/// foxglove.PoseInFrame of three channels; along the channels "axis_x" ... where there are some.
std::optional<RowTopic> RunTopics::of_pose(const StreamInfo& stream, const std::string& name,
                                           const std::string& prefix) const {
  const VectorColumns position = columns_of(stream, prefix);
  if (!position.there()) return {};
  const VectorColumns axis = columns_of(stream, prefix + "axis_");
  // The function has copies of all that it uses: it is called when the description is gone.
  return RowTopic{
      foxglove_topic(name, "PoseInFrame"),
      [=, clock = clock_](Time time, std::span<const double> row) -> std::optional<std::string> {
        const auto at = position.of(row);
        if (!at) return {};
        const auto direction = axis.of(row);
        return json_text({{"timestamp", clock.stamp(time)},
                          {"frame_id", "world"},
                          {"pose", pose_json(*at, direction ? along(*direction)
                                                            : Eigen::Quaterniond::Identity())}});
      }};
}

std::vector<RowTopic> RunTopics::of_servo(const StreamInfo& stream) const {
  std::vector<RowTopic> topics;
  if (auto pose = of_pose(stream, "/robot/pose", "")) topics.push_back(*pose);
  if (auto pose = of_pose(stream, "/target/pose", "target_")) topics.push_back(*pose);
  const EllipseColumns ellipse(stream);
  if (ellipse.there())
    topics.push_back({foxglove_topic("/top_camera/annotations", "ImageAnnotations"),
                      [ellipse, clock = clock_](Time time, std::span<const double> row) {
                        return annotations_text(clock.stamp(time), ellipse.outline(row));
                      }});
  const VectorColumns robot = columns_of(stream, "");
  const VectorColumns axis = columns_of(stream, "axis_");
  const VectorColumns sigma = columns_of(stream, "sigma_");
  const VectorColumns target = columns_of(stream, "target_");
  // Also the scene's part that moves goes by the rows of the servo.
  topics.push_back({scene(), [=, scene = scene_](Time time, std::span<const double> row) {
                      return json_text(scene->row(
                          time, {robot.of(row), axis.of(row), sigma.of(row), target.of(row)}));
                    }});
  return topics;
}

Topic RunTopics::log() { return foxglove_topic("/log", "Log"); }

std::string RunTopics::log_message(Time time, const std::string& kind,
                                   const std::string& text) const {
  const auto [file, line] = file_and_line(text);
  return json_text({{"timestamp", clock_.stamp(time)},
                    {"level", log_level(kind, text)},
                    {"message", text},
                    {"name", kind},
                    {"file", file},
                    {"line", line}});
}

Topic RunTopics::image(const std::string& camera, bool deep) {
  return foxglove_topic("/" + camera + "/image", deep ? "RawImage" : "CompressedImage");
}

// The picture's text is appended and not made a JSON value: as one it would be checked letter by
// letter, which took longer than to encode the picture.
std::string RunTopics::image_message(const std::string& camera, Time exposed, const cv::Mat& image,
                                     ImageCoding coding) const {
  json message = {{"timestamp", clock_.stamp(exposed)}, {"frame_id", camera}};
  std::string data;
  if (image.depth() == CV_16U) {
    // Rows without room between them, since `step` is the bytes of a row's pixels.
    const cv::Mat whole = image.isContinuous() ? image : image.clone();
    message["width"] = whole.cols;
    message["height"] = whole.rows;
    // Foxglove's word for 16 bits of gray, little-endian as this machine is.
    message["encoding"] = "mono16";
    message["step"] = whole.cols * whole.elemSize();
    data = base64({whole.data, whole.total() * whole.elemSize()});
  } else {
    std::vector<unsigned char> bytes;
    const bool jpeg = coding == ImageCoding::jpeg;
    // PNG with OpenCV's own strategy (run lengths, one filter): of a camera's noise as small as the
    // searching ones make it, in half the time.
    const std::vector<int> how =
        jpeg ? std::vector<int>{cv::IMWRITE_JPEG_QUALITY, kJpegQuality} : std::vector<int>{};
    if (!cv::imencode(jpeg ? ".jpg" : ".png", image, bytes, how))
      throw std::runtime_error(camera + ": its picture cannot be encoded");
    message["format"] = jpeg ? "jpeg" : "png";
    data = base64(bytes);
  }
  std::string text = json_text(message);
  text.pop_back();  // the closing brace
  return text.append(",\"data\":\"").append(data).append("\"}");
}

Topic RunTopics::scene() { return foxglove_topic("/scene", "SceneUpdate"); }

std::optional<std::string> RunTopics::scene_message(Time time) const {
  const auto eye = scene_->eye(time);
  return eye ? std::optional(json_text(*eye)) : std::nullopt;
}

Topic RunTopics::transforms() { return foxglove_topic("/tf", "FrameTransforms"); }

std::string RunTopics::transforms_message(Time time) const {
  return json_text(scene_->transforms(time));
}

}  // namespace vitreo
