// SPDX-License-Identifier: Apache-2.0
#include "host/frame_recording.h"

#include "devices/error.h"
#include "host/config.h"

#include <algorithm>
#include <charconv>
#include <optional>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

constexpr int kLongestStride = 1000000;

}  // namespace

FramePolicy parse_frame_policy(const std::string& word) {
  const std::size_t slash = word.find('/');
  FramePolicy policy{word.substr(0, slash), 1};
  if (slash == std::string::npos) return policy;
  const char *begin = word.data() + slash + 1, *end = word.data() + word.size();
  const auto [last, error] = std::from_chars(begin, end, policy.every);
  if (error != std::errc() || last != end || policy.every < 1 || policy.every > kLongestStride)
    throw ConfigError("frames: " + word +
                      ": wants a camera's role and how many frames there are to one that is kept, "
                      "such as top_camera/5");
  return policy;
}

class FrameRecording::Tap final : public Camera {
 public:
  Tap(Camera*& place, std::string name, Clock& clock, Recorder& recorder)
      : name_(std::move(name)), place_(place), camera_(*place), clock_(clock), recorder_(recorder) {
    place_ = this;
  }
  ~Tap() override { place_ = &camera_; }
  Tap(const Tap&) = delete;
  Tap& operator=(const Tap&) = delete;
  const CameraInfo& info() const override { return camera_.info(); }
  const std::string& name() const { return name_; }

  Frame grab(Time timeout) override {
    struct Count {
      explicit Count(int& of) : count(of) { ++count; }
      ~Count() { --count; }
      int& count;
    } const waiting(takers_);
    Frame frame = camera_.grab(timeout);
    taken_ = clock_.now();
    record(frame);
    return frame;
  }

  void start(int every) {
    recorded_ = recorder_.add_camera(
        {name_, camera_.info().identity, every, camera_.info().frame_period, camera_.info().effective_pixel});
    every_ = every;
  }

  /// Takes the frames that nobody else takes, for as long as the session lasts.
  void pump() {
    const Time patience = from_seconds(3 * camera_.info().frame_period);
    while (true) {
      if (takers_ > 0 || (taken_ && clock_.now() - *taken_ < patience)) {
        clock_.sleep_for(patience);
        continue;
      }
      try {
        record(camera_.grab(later(patience, from_seconds(1))));
      } catch (const DeviceError& error) {
        if (!std::exchange(silent_, true)) recorder_.event(clock_.now(), "alarm", name_ + ": " + error.what());
        clock_.sleep_for(patience);
      }
    }
  }

 private:
  void record(const Frame& frame) {
    silent_ = false;
    if (recorded_ < 0 || (last_ && frame.number <= *last_)) return;  // two may be handed the same frame
    last_ = frame.number;
    if (count_++ % every_ == 0) recorder_.frame(recorded_, frame);
  }

  const std::string name_;
  Camera*& place_;
  Camera& camera_;
  Clock& clock_;
  Recorder& recorder_;
  int recorded_ = -1, every_ = 1, takers_ = 0;
  std::int64_t count_ = 0;
  std::optional<Time> taken_;
  std::optional<std::uint64_t> last_;
  bool silent_ = false;  // the camera is; it has been said
};

FrameRecording::FrameRecording(Clock& clock, Rig& rig, Recorder& recorder)
    : clock_(clock), rig_(rig), recorder_(recorder) {
  if (rig_.top_camera != nullptr)
    taps_.push_back(std::make_unique<Tap>(rig_.top_camera, "top_camera", clock_, recorder_));
  if (rig_.side_camera != nullptr)
    taps_.push_back(std::make_unique<Tap>(rig_.side_camera, "side_camera", clock_, recorder_));
}

FrameRecording::~FrameRecording() { pumps_.clear(); }

void FrameRecording::start(const FramePolicy& policy) {
  const auto found =
      std::find_if(taps_.begin(), taps_.end(), [&](const auto& tap) { return tap->name() == policy.camera; });
  if (found == taps_.end()) throw std::invalid_argument("there is no camera " + policy.camera + " on this rig");
  Tap& tap = **found;
  tap.start(policy.every);
  pumps_.push_back(clock_.spawn("frames of " + policy.camera, [&tap] { tap.pump(); }));
}

}  // namespace vitreo
