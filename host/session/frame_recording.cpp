// SPDX-License-Identifier: Apache-2.0
#include "host/session/frame_recording.h"

#include "devices/time/error.h"
#include "host/config/config.h"
#include "host/session/clock_map.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <deque>
#include <optional>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

constexpr int kLongestStride = 1000000, kSmallestWindow = 8, kLargestWindow = 8192;
constexpr double kLongestAround = 600;                 // s
constexpr std::size_t kRing = std::size_t{512} << 20;  // bytes of frames that wait for an event

template <class Number>
Number number_after(const std::string& word, std::size_t& at, double min, double max) {
  Number value{};
  const char *begin = word.data() + at + 1, *end = word.data() + word.size();
  const auto [last, error] = std::from_chars(begin, end, value);
  if (error != std::errc() ||
      !(value >= static_cast<Number>(min) && value <= static_cast<Number>(max)))
    throw ConfigError(
        "frames: " + word +
        ": wants a camera's role and, if need be, how many frames there are to one that is kept "
        "(/5), the "
        "pixels of a window about the robot (@96), the seconds around events (~10), such as "
        "top_camera/5@96~10");
  at = static_cast<std::size_t>(last - word.data());
  return value;
}

std::size_t bytes_of(const Frame& frame) { return frame.image.total() * frame.image.elemSize(); }

}  // namespace

FramePolicy parse_frame_policy(const std::string& word) {
  std::size_t at = std::min(word.find_first_of("/@~"), word.size());
  FramePolicy policy;
  policy.camera = word.substr(0, at);
  while (at < word.size()) {
    const char mark = word[at];
    if (mark == '/')
      policy.every = number_after<int>(word, at, 1, kLongestStride);
    else if (mark == '@')
      policy.window = number_after<int>(word, at, kSmallestWindow, kLargestWindow);
    else if (mark == '~')
      policy.around = number_after<double>(word, at, 0.1, kLongestAround);
    else
      number_after<int>(word, at, 1, 0);  // no mark: throws
  }
  return policy;
}

bool keeps_frames(const std::string& event_kind) {
  constexpr std::array kinds{"alarm",  "interlock",    "lost", "error",
                             "unsafe", "servo failed", "keep"};
  return std::find(kinds.begin(), kinds.end(), event_kind) != kinds.end();
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
    map_clock(frame);
    record(frame);
    return frame;
  }

  /// True the first time that it is asked.
  bool wants_pump() { return !std::exchange(pumped_, true); }

  void start(const FramePolicy& policy) {
    const CameraInfo& info = camera_.info();
    if (policy.window > std::min(info.width_px, info.height_px))
      throw std::invalid_argument("window: is larger than the frames of " + name_);
    const int whole =
        static_cast<int>(std::max(1.0, std::round(1 / info.frame_period)));  // one a second
    recorded_ =
        recorder_.add_camera({name_, info.identity, policy.window > 0 ? whole : policy.every,
                              info.frame_period, info.effective_pixel});
    if (policy.window > 0) {
      windows_ = recorder_.add_camera({name_ + "_window", info.identity, policy.every,
                                       info.frame_period, info.effective_pixel});
      corners_ = recorder_.add_stream({name_ + "_window",
                                       "where the recorded windows stand in the frames",
                                       {{"frame", ""}, {"left_px", ""}, {"top_px", ""}}});
    }
    policy_ = policy;
    whole_ = policy.window > 0 ? whole : policy.every;
    events_seen_ = recorder_.events().size();
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
        const Frame frame = camera_.grab(later(patience, from_seconds(1)));
        map_clock(frame);
        record(frame);
      } catch (const DeviceError& error) {
        if (!std::exchange(silent_, true))
          recorder_.alarm(clock_.now(), name_, AlarmPriority::medium, error.what());
        clock_.sleep_for(patience);
      }
    }
  }

 private:
  /// The instrument's clock against ours, once a second, as the stream NAME_clock.
  void map_clock(const Frame& frame) {
    if (!frame.device) return;
    map_.add(*frame.device, frame.exposed);
    const auto offset = map_.now();
    if (!offset || (mapped_ && frame.exposed - *mapped_ < std::chrono::seconds(1))) return;
    mapped_ = frame.exposed;
    if (clock_stream_ < 0)
      clock_stream_ =
          recorder_.add_stream({name_ + "_clock",
                                "what to add to the instrument's own time to have the host's",
                                {{"offset", "s"}, {"drift", ""}}});
    recorder_.sample(clock_stream_, frame.exposed, std::array{offset->offset, offset->drift});
  }

  void record(const Frame& frame) {
    silent_ = false;
    if (RecordListener* const listener = recorder_.listener()) listener->seen(name_, frame);
    if (recorded_ < 0 || (last_ && frame.number <= *last_))
      return;  // two may be handed the same frame
    last_ = frame.number;
    if (policy_.around <= 0) return keep(frame, count_++);
    const Time around = from_seconds(policy_.around);
    if (something_happened()) until_ = frame.exposed + around;
    ring_.emplace_back(frame, count_++);
    ring_bytes_ += bytes_of(frame);
    const bool now = until_ && frame.exposed <= *until_;
    while (!ring_.empty() &&
           (now || ring_bytes_ > kRing || ring_.front().first.exposed < frame.exposed - around)) {
      if (now) keep(ring_.front().first, ring_.front().second);
      ring_bytes_ -= bytes_of(ring_.front().first);
      ring_.pop_front();
    }
  }

  bool something_happened() {
    const std::vector<Event>& events = recorder_.events();
    const bool some =
        std::any_of(events.begin() + static_cast<std::ptrdiff_t>(events_seen_), events.end(),
                    [](const Event& event) { return keeps_frames(event.kind); });
    events_seen_ = events.size();
    return some;
  }

  void keep(const Frame& frame, std::int64_t count) {
    if (count % whole_ == 0) recorder_.frame(recorded_, frame);
    if (windows_ >= 0 && count % policy_.every == 0) keep_window(frame);
  }

  void keep_window(const Frame& frame) {
    const auto place = robot_px();
    if (!place) return;
    const int size = policy_.window;
    const auto corner = [size](double center, int length) {
      return std::clamp(static_cast<int>(std::lround(center)) - size / 2, 0, length - size);
    };
    const int left = corner((*place)[0], frame.image.cols),
              top = corner((*place)[1], frame.image.rows);
    Frame window = frame;
    window.image = frame.image(cv::Rect(left, top, size, size)).clone();
    recorder_.frame(windows_, window);
    recorder_.sample(corners_, frame.exposed,
                     std::array{static_cast<double>(frame.number), static_cast<double>(left),
                                static_cast<double>(top)});
  }

  /// Where the servo, or for the side camera its observer, last saw it; nothing before.
  std::optional<std::array<double, 2>> robot_px() const {
    const Stream* const servo = name_ == "top_camera" ? recorder_.stream("servo") : nullptr;
    if (servo == nullptr) return std::nullopt;
    const auto channel = [servo](const char* name) {
      const auto& all = servo->info.channels;
      return static_cast<std::size_t>(
          std::find_if(all.begin(), all.end(),
                       [name](const Channel& one) { return one.name == name; }) -
          all.begin());
    };
    const std::size_t u = channel("u_px"), v = channel("v_px"), count = servo->info.channels.size();
    if (u == count || v == count) return std::nullopt;
    for (std::size_t row = servo->times.size(); row-- > 0 && servo->times.size() - row < 100;)
      if (std::isfinite(servo->at(row, u))) return std::array{servo->at(row, u), servo->at(row, v)};
    return std::nullopt;
  }

  const std::string name_;
  Camera*& place_;
  Camera& camera_;
  Clock& clock_;
  Recorder& recorder_;
  int recorded_ = -1, windows_ = -1, corners_ = -1, whole_ = 1, takers_ = 0;
  FramePolicy policy_;
  std::deque<std::pair<Frame, std::int64_t>> ring_;  // and their counts
  std::size_t ring_bytes_ = 0, events_seen_ = 0;
  std::optional<Time> until_, mapped_;
  ClockMap map_;
  int clock_stream_ = -1;
  std::int64_t count_ = 0;
  std::optional<Time> taken_;
  std::optional<std::uint64_t> last_;
  bool pumped_ = false;
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

FrameRecording::Tap& FrameRecording::tap_of(const FramePolicy& policy) const {
  const auto found = std::find_if(taps_.begin(), taps_.end(),
                                  [&](const auto& tap) { return tap->name() == policy.camera; });
  if (found == taps_.end())
    throw std::invalid_argument("there is no camera " + policy.camera + " on this rig");
  return **found;
}

void FrameRecording::check(const FramePolicy& policy) const { tap_of(policy); }

void FrameRecording::start(const FramePolicy& policy) {
  Tap& tap = tap_of(policy);
  tap.start(policy);
  if (tap.wants_pump())
    pumps_.push_back(clock_.spawn("frames of " + policy.camera, [&tap] { tap.pump(); }));
}

void FrameRecording::watch() {
  for (const auto& tap : taps_)
    if (tap->wants_pump())
      pumps_.push_back(clock_.spawn("frames of " + tap->name(), [&tap = *tap] { tap.pump(); }));
}

}  // namespace vitreo
