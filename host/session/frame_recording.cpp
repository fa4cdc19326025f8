// SPDX-License-Identifier: Apache-2.0
#include "host/session/frame_recording.h"

#include "devices/time/error.h"
#include "host/config/config.h"
#include "host/record/meaning.h"
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

constexpr int kLongestStride = 1000000;
constexpr int kSmallestWindow = 8;                     // px
constexpr int kLargestWindow = 8192;                   // px
constexpr double kLongestAround = 600;                 // s
constexpr std::size_t kRing = std::size_t{512} << 20;  // bytes of frames that wait for an event

template <class Number>
/// Reads the number behind the mark at `at`, and moves `at` behind it. Throws ConfigError for none,
/// or one out of [min, max].
Number number_after(const std::string& word, std::size_t& at, double min, double max) {
  Number value{};
  const char* const begin = word.data() + at + 1;
  const char* const end = word.data() + word.size();
  const auto [last, error] = std::from_chars(begin, end, value);
  if (error != std::errc() ||
      !(value >= static_cast<Number>(min) && value <= static_cast<Number>(max)))
    throw ConfigError(
        "frames: " + word +
        ": wants a camera's role and, if need be, how many frames there are to one that is kept "
        "(/5), the pixels of a window about the robot (@96), the seconds around events (~10), such "
        "as "
        "top_camera/5@96~10");
  at = static_cast<std::size_t>(last - word.data());
  return value;
}

// Of the pixels, which the ring keeps alive by sharing them with the camera's frame.
std::size_t bytes_of(const Frame& frame) {
  const auto bytes = [](const cv::Mat& image) {
    return image.empty() ? 0 : image.total() * image.elemSize();
  };
  return bytes(frame.image) + bytes(frame.deep);
}

}  // namespace

// ROLE[/every][@window][~around], the parts behind the role in any order.
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
  // Events after which a reader of the record wants to see the scene.
  constexpr std::array kinds{"alarm",  "interlock",    "lost", "error",
                             "unsafe", "servo failed", "keep"};
  return std::find(kinds.begin(), kinds.end(), event_kind) != kinds.end();
}

/// Decorator of one camera: it stands in the rig's slot for the camera, and records the frames that
/// callers grab through it.
class FrameRecording::Tap final : public Camera {
 public:
  Tap(Camera*& slot, std::string name, Clock& clock, Recorder& recorder)
      : name_(std::move(name)), slot_(slot), camera_(*slot), clock_(clock), recorder_(recorder) {
    slot_ = this;
  }
  ~Tap() override { slot_ = &camera_; }
  Tap(const Tap&) = delete;
  Tap& operator=(const Tap&) = delete;
  const CameraInfo& info() const override { return camera_.info(); }
  const std::string& name() const { return name_; }
  CameraStatistics statistics() const override { return camera_.statistics(); }
  std::string feature(const std::string& name) override { return camera_.feature(name); }
  // Settings of an instrument are what a run was made with: each change is an event.
  std::string set_feature(const std::string& name, const std::string& value) override {
    std::string read = camera_.set_feature(name, value);
    recorder_.event(clock_.now(), "note",
                    name_ + ": feature " + name + (read.empty() ? " executed" : " = " + read));
    return read;
  }

  // What a caller gets is offered to the record in the same call, so what is recorded is what the
  // loop saw, in its order.
  Frame grab(Time timeout) override {
    // Counted while it waits, so that the pump leaves the camera alone.
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

  Time patience() const { return from_seconds(3 * camera_.info().frame_period); }

  /// True the first time that it is asked.
  bool wants_pump() { return !std::exchange(pumped_, true); }

  // The recorder throws where the camera is recorded already. `every` counts from the first frame
  // that is grabbed after this.
  void start(const FramePolicy& policy) {
    const CameraInfo& info = camera_.info();
    if (policy.window > std::min(info.width_px, info.height_px))
      throw std::invalid_argument("window: is larger than the frames of " + name_);
    // With windows, one whole frame a second.
    const int whole = static_cast<int>(std::max(1.0, std::round(1 / info.frame_period)));
    recorded_ = recorder_.add_camera(recorded_as(name_, policy.window > 0 ? whole : policy.every));
    if (policy.window > 0) {
      // Windows are a camera of their own in the record, and their corners a stream: a reader finds
      // a pixel of the whole frame again.
      windows_ = recorder_.add_camera(recorded_as(name_ + "_window", policy.every));
      corners_ = recorder_.add_stream({name_ + "_window",
                                       "where the recorded windows stand in the frames",
                                       {{"frame", "1", "the camera's number of the frame"},
                                        {"left_px", "px", "column of the window's first pixel"},
                                        {"top_px", "px", "row of the window's first pixel"}},
                                       kExposure});
    }
    policy_ = policy;
    whole_ = policy.window > 0 ? whole : policy.every;
    // Events before the start do not keep frames.
    events_seen_ = recorder_.events().size();
  }

  /// Grabs frames while no caller does, for as long as the session lasts. Two that grab from one
  /// camera would take frames from each other, so it gives way for three frame periods.
  void pump() {
    while (true) {
      if (takers_ > 0 || (taken_ && clock_.now() - *taken_ < patience()))
        clock_.sleep_for(patience());
      else
        pump_once();
    }
  }

  /// A frame that no caller wants, or the alarm that none comes.
  void pump_once() {
    try {
      const Frame frame = camera_.grab(later(patience(), from_seconds(1)));
      map_clock(frame);
      record(frame);
    } catch (const DeviceError& error) {
      // One alarm until a frame comes again.
      if (!std::exchange(silent_, true))
        recorder_.alarm(clock_.now(), name_, AlarmPriority::medium, error.what());
      clock_.sleep_for(patience());
    }
  }

 private:
  RecordedCameraInfo recorded_as(const std::string& name, int every) const {
    const CameraInfo& info = camera_.info();
    return {name,      info.identity,    every,           info.frame_period, info.effective_pixel,
            info.bits, info.offset_x_px, info.offset_y_px};
  }

  /// Records the instrument's clock against the host's, once a second, as the stream NAME_clock.
  /// A stream only for instruments with a clock of their own; readers of the record convert its
  /// times by it. One row a second is enough for a drift of parts per million.
  void map_clock(const Frame& frame) {
    if (!frame.device) return;
    map_.add(*frame.device, frame.exposed);
    const auto offset = map_.now();
    if (!offset || (mapped_ && frame.exposed - *mapped_ < std::chrono::seconds(1))) return;
    mapped_ = frame.exposed;
    // The stream begins with the first offset: an instrument without a clock has none.
    if (clock_stream_ < 0)
      clock_stream_ =
          recorder_.add_stream({name_ + "_clock",
                                "what to add to the instrument's own time to have the host's",
                                {{"offset", "s", "host's clock less the instrument's"},
                                 {"drift", "1", "rate of the offset, s per s"}},
                                kExposure});
    recorder_.sample(clock_stream_, frame.exposed, std::array{offset->offset, offset->drift});
  }

  void record(const Frame& frame) {
    silent_ = false;
    // The live view gets every frame, recorded or not.
    if (RecordListener* const listener = recorder_.listener()) listener->seen(name_, frame);
    // Two callers may be handed the same frame.
    if (recorded_ < 0 || (last_ && frame.number <= *last_)) return;
    // Numbers count exposures: what is missing between two never came, or was not taken in time.
    if (last_) lost_ += frame.number - *last_ - 1;
    last_ = frame.number;
    if (policy_.around <= 0) return keep({frame, count_++, lost_});
    const Time around = from_seconds(policy_.around);
    if (something_happened()) until_ = frame.exposed + around;
    ring_.push_back({frame, count_++, lost_});
    ring_bytes_ += bytes_of(frame);
    // A frame within `around` of an event is kept at once, with those in the ring before it; else
    // the ring forgets what is older than `around`, or beyond its bytes.
    const bool now = until_ && frame.exposed <= *until_;
    while (!ring_.empty() &&
           (now || ring_bytes_ > kRing || ring_.front().frame.exposed < frame.exposed - around)) {
      if (now) keep(ring_.front());
      ring_bytes_ -= bytes_of(ring_.front().frame);
      ring_.pop_front();
    }
  }

  /// Whether the record has an event since the last call that keeps frames.
  /// Events are only appended, so an index is enough to know the new ones.
  bool something_happened() {
    const std::vector<Event>& events = recorder_.events();
    const bool some =
        std::any_of(events.begin() + static_cast<std::ptrdiff_t>(events_seen_), events.end(),
                    [](const Event& event) { return keeps_frames(event.kind); });
    events_seen_ = events.size();
    return some;
  }

  struct Taken {
    Frame frame;
    std::int64_t count = 0;  // its place since start()
    std::uint64_t lost = 0;  // exposures that were missing since start()
  };

  // A frame that waited in the ring is thinned out as it would have been at once.
  void keep(const Taken& taken) {
    if (taken.count % whole_ == 0)
      recorder_.frame(recorded_, taken.frame,
                      taken.lost - std::exchange(lost_before_whole_, taken.lost));
    if (windows_ >= 0 && taken.count % policy_.every == 0) keep_window(taken);
  }

  void keep_window(const Taken& taken) {
    const Frame& frame = taken.frame;
    const auto robot = robot_px();
    if (!robot) return;
    const int size = policy_.window;
    const auto corner = [size](double center, int length) {
      // At the border the window is moved inwards, so that all have one size.
      return std::clamp(static_cast<int>(std::lround(center)) - size / 2, 0, length - size);
    };
    const int left = corner((*robot)[0], frame.image.cols);
    const int top = corner((*robot)[1], frame.image.rows);
    Frame window = frame;
    // A copy: the view would keep the whole frame in memory.
    const cv::Rect part(left, top, size, size);
    window.image = frame.image(part).clone();
    if (!frame.deep.empty()) window.deep = frame.deep(part).clone();
    recorder_.frame(windows_, window, taken.lost - std::exchange(lost_before_window_, taken.lost));
    recorder_.sample(corners_, frame.exposed,
                     std::array{static_cast<double>(frame.number), static_cast<double>(left),
                                static_cast<double>(top)});
  }

  /// Pixel of the robot in the top camera as the servo last saw it, within 100 rows; nothing
  /// before, and for other cameras.
  std::optional<std::array<double, 2>> robot_px() const {
    const Stream* const servo = name_ == "top_camera" ? recorder_.stream("servo") : nullptr;
    if (servo == nullptr) return std::nullopt;
    // Index of a channel of that name; the number of channels where there is none.
    const auto channel = [servo](const char* name) {
      const auto& all = servo->info.channels;
      return static_cast<std::size_t>(
          std::find_if(all.begin(), all.end(),
                       [name](const Channel& one) { return one.name == name; }) -
          all.begin());
    };
    const std::size_t u = channel("u_px");
    const std::size_t v = channel("v_px");
    const std::size_t count = servo->info.channels.size();
    if (u == count || v == count) return std::nullopt;
    // NaN where the robot was lost.
    for (std::size_t row = servo->times.size(); row-- > 0 && servo->times.size() - row < 100;)
      if (std::isfinite(servo->at(row, u))) return std::array{servo->at(row, u), servo->at(row, v)};
    return std::nullopt;
  }

  const std::string name_;
  Camera*& slot_;  // of the rig; holds this decorator
  Camera& camera_;
  Clock& clock_;
  Recorder& recorder_;
  FramePolicy policy_;
  // The recorder's numbers of the camera, its windows and their corners; -1: none.
  int recorded_ = -1;
  int windows_ = -1;
  int corners_ = -1;
  int whole_ = 1;  // each n-th frame is recorded whole
  // Exposures that are missing since start(): all, and those before the last recorded frame.
  std::uint64_t lost_ = 0;
  std::uint64_t lost_before_whole_ = 0;
  std::uint64_t lost_before_window_ = 0;
  int takers_ = 0;                     // callers that wait in grab()
  std::int64_t count_ = 0;             // frames since start()
  std::optional<std::uint64_t> last_;  // number of the last frame that was counted
  std::optional<Time> taken_;          // when a caller last got a frame
  // Around events: frames with their counts that wait for one.
  std::deque<Taken> ring_;
  std::size_t ring_bytes_ = 0;
  std::size_t events_seen_ = 0;
  std::optional<Time> until_;  // exposures up to this are kept
  ClockMap map_;
  int clock_stream_ = -1;
  std::optional<Time> mapped_;  // the last sample of that stream
  bool pumped_ = false;
  bool silent_ = false;  // the camera is; its alarm was raised
};

FrameRecording::FrameRecording(Clock& clock, Rig& rig, Recorder& recorder)
    : clock_(clock), rig_(rig), recorder_(recorder) {
  if (rig_.top_camera != nullptr)
    taps_.push_back(std::make_unique<Tap>(rig_.top_camera, "top_camera", clock_, recorder_));
  if (rig_.side_camera != nullptr)
    taps_.push_back(std::make_unique<Tap>(rig_.side_camera, "side_camera", clock_, recorder_));
}

// The pumps use the taps.
// They are tasks: clearing the list stops and joins them.
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
  // A camera's first picture may take long: a simulated one computes where each pixel looks, 0.2 s.
  // Here no current flows yet; later, at the pace of the wall clock, the dead-man would feel it.
  for (const auto& tap : taps_)
    if (tap->wants_pump()) {
      tap->pump_once();
      pumps_.push_back(clock_.spawn("frames of " + tap->name(), [&tap = *tap] { tap.pump(); }));
    }
}

}  // namespace vitreo
