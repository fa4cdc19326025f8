// Topics of a run: names, schemas and messages of its streams, log, pictures and scene, the same in
// an exported file and live.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/channels/foxglove_schema.h"
#include "host/channels/run_scene.h"
#include "host/record/run_data.h"

#include <nlohmann/json.hpp>
#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace vitreo {

struct Topic {
  std::string name;         // "/servo"
  std::string schema_name;  // "vitreo.servo", "foxglove.Log"
  nlohmann::json schema;
};

/// A topic that is fed by the rows of one stream. Two of them may have one name, as the scene has.
struct RowTopic {
  Topic topic;
  /// The message of a row as JSON text; nothing where the row says nothing about it.
  std::function<std::optional<std::string>(Time, std::span<const double>)> message;
};

/// Lossless where it matters more than size: an export; or as small as a live picture.
enum class ImageCoding { lossless, jpeg };

class RunTopics {
 public:
  /// `start` of the record; `t0_utc_ns`: where the zero of its clock lies (ns since 1970, UTC).
  RunTopics(const RunStart& start, std::int64_t t0_utc_ns);
  const UtcClock& clock() const { return clock_; }

  /// The stream's own numbers first ("/NAME"; what is not a number is left out of the message),
  /// then what they mean: poses, annotations of a picture, the scene.
  std::vector<RowTopic> of_stream(const StreamInfo& stream) const;

  static Topic log();
  std::string log_message(Time time, const std::string& kind, const std::string& text) const;

  /// `deep`: of more than 8 bits, as foxglove.RawImage, for a picture's viewers show 8 bits alone.
  static Topic image(const std::string& camera, bool deep);
  /// 8-bit gray or BGR, or 16-bit gray. Throws std::runtime_error where it cannot be encoded.
  std::string image_message(const std::string& camera, Time exposed, const cv::Mat& image,
                            ImageCoding coding) const;

  static Topic scene();
  /// What stands still; nothing where the record has no geometry.
  std::optional<std::string> scene_message(Time time) const;
  static Topic transforms();
  std::string transforms_message(Time time) const;

 private:
  std::vector<RowTopic> of_servo(const StreamInfo& stream) const;
  std::optional<RowTopic> of_pose(const StreamInfo& stream, const std::string& name,
                                  const std::string& prefix) const;

  const UtcClock clock_;
  const std::shared_ptr<const RunScene> scene_;  // shared with the topics' functions
};

/// JSON text of whatever a script or a device has said: what is no UTF-8 is replaced.
std::string json_text(const nlohmann::json& json);

}  // namespace vitreo
