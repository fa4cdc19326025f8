// SPDX-License-Identifier: Apache-2.0
#include "host/cli/replay.h"

#include "devices/roles/gray.h"
#include "host/rig/measured_chain.h"
#include "host/runs/run_reader.h"
#include "host/servo/localizer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

namespace vitreo {
namespace {

/// A background learnt during the run: from which exposure on, until when, from how many frames.
/// As Session::learn_background() records it (event "background", JSON): every frame exposed at
/// `from` or later was learnt until there were `count`; `until` is the event's own time. Where not
/// every frame was recorded, the record holds fewer than `count` of them.
struct Learning {
  Time from{};
  Time until{};
  int count = 0;
};

// In the order of the events, which is that of time. Text that is no JSON is passed over: another
// version's record is no reason to fail. Only the top camera is replayed.
std::vector<Learning> learnings_of(const RunData& data) {
  std::vector<Learning> learnings;
  for (const Event& event : data.events) {
    if (event.kind != "background") continue;
    const nlohmann::json json = nlohmann::json::parse(event.text, nullptr, false);
    if (!json.is_object() || json.value("camera", "") != "top_camera") continue;
    learnings.push_back(
        {Time(json.value("from_ns", std::int64_t{0})), event.time, json.value("count", 0)});
  }
  return learnings;
}

/// What the servo was set to.
struct Setting {
  Eigen::Vector3d axis;   // the robot's
  double axis_sigma = 0;  // rad; 0: taken for known
  bool by_chain = false;  // by the measured chain, if the rig had one
};

/// Of the last servo in the record, as earlier ones may be those of a preparation; nothing where
/// none names an axis. A servo with other settings is replayed with these.
std::optional<Setting> setting_of(const RunData& data) {
  std::optional<Setting> last;
  for (const Event& event : data.events) {
    if (event.kind != "servo") continue;
    const nlohmann::json json = nlohmann::json::parse(event.text, nullptr, false);
    if (!json.is_object() || !json.contains("axis") || !json["axis"].is_array() ||
        json["axis"].size() != 3)
      continue;
    last = {{json["axis"][0].get<double>(), json["axis"][1].get<double>(),
             json["axis"][2].get<double>()},
            json.value("axis_sigma", 0.0),
            json.value("chain", false)};
  }
  return last;
}

/// By the exposure's time: where the loop saw the robot.
/// The stream "servo" carries the exposure's time as its key, the same that the frame's row has, so
/// frames and rows match exactly. NaN in the record is "lost", which is nullopt here.
std::map<Time, std::optional<Eigen::Vector3d>> seen_then(const RunData& data) {
  const Stream* const servo = data.stream("servo");
  if (!servo) throw RecordError(data.folder.string() + ": has no stream servo to compare with");
  std::array<std::size_t, 3> xyz{};
  for (std::size_t i = 0; i < 3; ++i) {
    const auto& channels = servo->info.channels;
    const auto found = std::find_if(channels.begin(), channels.end(), [&](const Channel& one) {
      return one.name == std::string(1, "xyz"[i]);
    });
    if (found == channels.end())
      throw RecordError(data.folder.string() + ": its stream servo has no x, y and z");
    xyz[i] = static_cast<std::size_t>(found - channels.begin());
  }
  std::map<Time, std::optional<Eigen::Vector3d>> seen;
  for (std::size_t row = 0; row < servo->times.size(); ++row) {
    const Eigen::Vector3d position(servo->at(row, xyz[0]), servo->at(row, xyz[1]),
                                   servo->at(row, xyz[2]));
    seen[servo->times[row]] = position.allFinite() ? std::optional(position) : std::nullopt;
  }
  return seen;
}

/// Takes the frames in order: those of a background are learnt, those of the servo are localized.
class Player {
 public:
  Player(const RunData& data, const RigModel& model)
      : data_(data), model_(model), learnings_(learnings_of(data)), seen_(seen_then(data)) {
    const auto setting = setting_of(data);
    if (!setting || !setting->by_chain) model_ = without_measured_chain(std::move(model_));
    if (!setting) return;
    result_.axis = setting->axis;
    result_.axis_known = true;
    if (setting->by_chain) axis_sigma_ = setting->axis_sigma;
  }

  Replay play() {
    for (const FrameRow& row : data_.frames)
      if (row.camera == "top_camera") take(row);
    if (result_.frames.empty())
      throw RecordError(
          data_.folder.string() +
          ": cannot be replayed: it wants the top camera's recorded frames (vitreo run --frames "
          "top_camera), of its background and of its servo loop");
    return std::move(result_);
  }

 private:
  // While a learning is due its frames are learnt and not localized, as in the run. A frame without
  // a row in the servo's stream was not used by the loop: there is nothing to compare it with.
  void take(const FrameRow& row) {
    while (next_ < learnings_.size() && row.exposed > learnings_[next_].until) use_background();
    const auto then = seen_.find(row.exposed);
    if (next_ < learnings_.size() && row.exposed >= learnings_[next_].from && then == seen_.end())
      return learn(row);
    if (!localizer_ || then == seen_.end()) return;
    const Observation observation = localizer_->look(seen(row));
    result_.frames.push_back({row.number, row.exposed, then->second, observation.position});
  }

  /// The image as the loop saw it: of the recorded bits eight, of color the luma.
  cv::Mat seen(const FrameRow& row) const {
    const auto camera =
        std::find_if(data_.cameras.begin(), data_.cameras.end(),
                     [&row](const RecordedCameraInfo& one) { return one.camera == row.camera; });
    return in_gray(read_frame(data_, row), camera == data_.cameras.end() ? 16 : camera->bits);
  }

  void learn(const FrameRow& row) {
    background_.learn(seen(row));
    ++result_.background_frames;
    if (background_.count() >= learnings_[next_].count) use_background();
  }

  // The background that was learnt is handed over whole and the next one starts empty, as
  // Session::learn_background() makes a new one each time. Of fewer than two frames none is made:
  // there is nothing to localize with until the next.
  void use_background() {
    ++next_;
    vision::Background learnt = std::exchange(background_, {});
    localizer_.reset();
    if (learnt.count() >= 2)
      localizer_.emplace(model_, std::move(learnt), result_.axis, axis_sigma_);
  }

  const RunData& data_;
  RigModel model_;
  const std::vector<Learning> learnings_;
  const std::map<Time, std::optional<Eigen::Vector3d>> seen_;
  double axis_sigma_ = 0;
  std::size_t next_ = 0;  // of the learnings
  vision::Background background_;
  std::optional<Localizer> localizer_;
  Replay result_;
};

}  // namespace

// |replayed - recorded| in 3-D, m. `same` wants a distance of exactly 0: the replay does the same
// arithmetic on the same bytes, so a difference is one of the program, the model or the machine.
ReplayStatistics Replay::statistics() const {
  ReplayStatistics statistics;
  double sum = 0;
  double squares = 0;
  for (const ReplayedFrame& frame : frames) {
    ++statistics.frames;
    if (frame.recorded.has_value() != frame.replayed.has_value())
      ++(frame.recorded ? statistics.only_recorded : statistics.only_replayed);
    if (!frame.recorded || !frame.replayed) continue;
    const double distance = (*frame.replayed - *frame.recorded).norm();
    ++statistics.compared;
    if (distance == 0) ++statistics.same;
    sum += distance;
    squares += distance * distance;
    statistics.max = std::max(statistics.max, distance);
  }
  if (statistics.compared == 0) return statistics;
  const double count = static_cast<double>(statistics.compared);
  statistics.mean = sum / count;
  statistics.rms = std::sqrt(squares / count);
  return statistics;
}

Replay replay(const RunData& data, const RigModel& model) { return Player(data, model).play(); }

}  // namespace vitreo
