// Driver of IIDC cameras: the bus, the region, the frames.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/iidc/driver.h"

#include "devices/time/error.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <stdexcept>
#include <utility>

#ifdef VITREO_HAVE_DC1394
#include "devices/instruments/iidc/features.h"
#include "devices/instruments/iidc/region.h"

#include <opencv2/core.hpp>

#include <bit>
#include <chrono>
#include <dc1394/dc1394.h>
#include <optional>
#include <poll.h>
#include <unistd.h>
#endif

namespace vitreo::iidc {

// Bounds of sense, not of a camera: what the camera itself cannot do is refused by it when it is
// opened.
void Settings::check() const {
  if (name.empty()) throw std::invalid_argument("name: must not be empty");
  const auto hexadecimal = [](unsigned char digit) { return std::isxdigit(digit) != 0; };
  if (!guid.empty() && (guid.size() != 16 || !std::all_of(guid.begin(), guid.end(), hexadecimal)))
    throw std::invalid_argument("guid: must be 16 hexadecimal digits");
  if (width_px < 1 || height_px < 1 || width_px > 1 << 14 || height_px > 1 << 14)
    throw std::invalid_argument("width_px, height_px: must be 1 to 16384");
  if (!(frame_rate > 0 && frame_rate <= 1e4))
    throw std::invalid_argument("frame_rate: must be in (0, 1e4] Hz");
  if (!(exposure > 0 && exposure <= 100))
    throw std::invalid_argument("exposure: must be in (0, 100] s");
  if (!std::isfinite(gain)) throw std::invalid_argument("gain: must be finite");
  if (!(shutter_unit >= 0 && shutter_unit <= 1))
    throw std::invalid_argument("shutter_unit: must be in [0, 1] s");
  if (!(effective_pixel > 0 && effective_pixel < 1))
    throw std::invalid_argument("effective_pixel: must be in (0, 1) m");
}

#ifndef VITREO_HAVE_DC1394

std::string why_not() { return "this program was built without libdc1394"; }
std::unique_ptr<Camera> open(const Settings& settings, Clock&) {
  settings.check();
  throw DeviceError(DeviceErrorKind::not_found, settings.name, why_not());
}

#else

namespace {

/// s after which a camera is lost.
constexpr double kSilence = 0.45;
/// Frames of the DMA ring.
constexpr unsigned kBuffers = 8;
/// FRAME_INTERVAL_INQ of Format 7 (IIDC 1.31): s, in single precision.
constexpr std::uint64_t kFrameInterval = 0x50;
/// How long a stop may have to wait for a frame.
constexpr Time kSlice = std::chrono::milliseconds(50);

/// Frames arrive by DMA in a ring of the kernel's; the driver takes all that wait and keeps the
/// last.
class IidcCamera final : public Camera {
 public:
  IidcCamera(const Settings& settings, Clock& clock)
      : settings_(settings),
        clock_(clock),
        library_(nullptr, dc1394_free),
        camera_(nullptr, dc1394_camera_free),
        running_(nullptr, stop) {
    clock_.outside([this] { start(); });
    heard_ = clock_.now();
  }
  IidcCamera(const IidcCamera&) = delete;
  IidcCamera& operator=(const IidcCamera&) = delete;
  ~IidcCamera() override {
    clock_.outside([this] { running_.reset(); });
  }
  const CameraInfo& info() const override { return info_; }
  CameraStatistics statistics() const override { return statistics_; }

  // What waits in the ring is taken first, so a late caller gets a frame at once. A camera that was
  // lost stays so until it is opened again.
  Frame grab(Time timeout) override {
    if (lost_) fail(DeviceErrorKind::lost, "it was lost; open it again");
    const Time deadline = later(clock_.now(), timeout);
    for (;;) {
      if (auto frame = newest()) return *std::move(frame);
      const Time now = clock_.now();
      if (to_seconds(now - heard_) > std::max(kSilence, 5 * info_.frame_period)) {
        lost_ = true;
        fail(DeviceErrorKind::lost, "it has fallen silent");
      }
      if (now >= deadline) fail(DeviceErrorKind::timeout, "no frame in time");
      wait(std::min(kSlice, deadline - now));
      clock_.sleep_until(clock_.now());  // a stop comes through here
    }
  }

 private:
  [[noreturn]] void fail(DeviceErrorKind kind, const std::string& what) const {
    throw DeviceError(kind, settings_.name, what);
  }
  // Of a node that is gone libdc1394 leaves the ring's descriptor open (and its memory).
  static void stop(dc1394camera_t* camera) {
    dc1394_video_set_transmission(camera, DC1394_OFF);
    const int ring = dc1394_capture_get_fileno(camera);
    if (dc1394_capture_stop(camera) == DC1394_IOCTL_FAILURE) ::close(ring);
  }

  // The order is libdc1394's: bus speed, mode, region, features, then the ring, and transmission
  // last. A program that crashed may have left the camera transmitting.
  void start() {
    library_.reset(dc1394_new());
    if (!library_) fail(DeviceErrorKind::not_found, "there is no FireWire bus");
    camera_.reset(dc1394_camera_new(library_.get(), guid()));
    if (!camera_) fail(DeviceErrorKind::not_found, "it does not answer, or another program has it");
    Features features(*camera_, settings_.name);
    features.need(dc1394_video_set_transmission(camera_.get(), DC1394_OFF), "transmission");
    set_speed(features);
    features.need(dc1394_video_set_mode(camera_.get(), kMode), "Format 7, mode 0");
    set_region(*camera_, features, settings_);
    transfer_ = set_packets(*camera_, features, settings_);
    features.set_manual();
    exposure_ = features.set_shutter(settings_.exposure, settings_.shutter_unit);
    const double gain = features.set_gain(settings_.gain);
    describe(features, gain);
    need_ring(dc1394_capture_setup(camera_.get(), kBuffers, DC1394_CAPTURE_FLAGS_DEFAULT));
    running_.reset(camera_.get());
    features.need(dc1394_video_set_transmission(camera_.get(), DC1394_ON), "transmission");
  }
  void set_speed(const Features& features) {
    if (settings_.fast_bus)
      features.need(dc1394_video_set_operation_mode(camera_.get(), DC1394_OPERATION_MODE_1394B),
                    "fast_bus");
    features.need(
        dc1394_video_set_iso_speed(
            camera_.get(), settings_.fast_bus ? DC1394_ISO_SPEED_800 : DC1394_ISO_SPEED_400),
        "fast_bus");
  }
  void need_ring(dc1394error_t code) const {
    if (code == DC1394_SUCCESS) return;
    fail(DeviceErrorKind::refused,
         std::string("the DMA ring: ") + dc1394_error_get_string(code) +
             "; cameras on one bus share what it carries: lower frame_rate or the region");
  }

  /// The 64 bits by which a FireWire device is known, in any port.
  std::uint64_t guid() const {
    if (!settings_.guid.empty()) return std::stoull(settings_.guid, nullptr, 16);
    dc1394camera_list_t* found = nullptr;
    if (dc1394_camera_enumerate(library_.get(), &found) != DC1394_SUCCESS)
      fail(DeviceErrorKind::not_found, "the FireWire bus cannot be searched");
    const std::unique_ptr<dc1394camera_list_t, decltype(&dc1394_camera_free_list)> list(
        found, dc1394_camera_free_list);
    if (list->num == 0) fail(DeviceErrorKind::not_found, "no FireWire camera is plugged in");
    if (list->num > 1) fail(DeviceErrorKind::not_found, "there are several; say which by its guid");
    return list->ids[0].guid;
  }

  /// s between frames: by the camera's own account, where it gives one, else as long as whatever
  /// takes longer. libdc1394's function for it takes the number's bits for a whole number.
  double frame_period() const {
    std::uint32_t bits = 0;
    if (dc1394_get_format7_register(camera_.get(), kMode, kFrameInterval, &bits) ==
        DC1394_SUCCESS) {
      const auto stated = static_cast<double>(std::bit_cast<float>(bits));
      if (stated >= 1 / kCycles && stated <= 1e3) return stated;
    }
    return std::max(transfer_, exposure_);
  }
  void describe(const Features& features, double gain) {
    info_ = {std::string(camera_->vendor == nullptr ? "" : camera_->vendor) + " " +
                 (camera_->model == nullptr ? "" : camera_->model),
             settings_.width_px, settings_.height_px, frame_period(), settings_.effective_pixel};
    info_.settings = {{"exposure (s)", text_of(exposure_)},
                      {"gain (" + std::string(features.gain_unit()) + ")", text_of(gain)},
                      {"frame period (s)", text_of(info_.frame_period)}};
  }

  /// Until a frame is in the ring, outside the clock's baton.
  void wait(Time timeout) {
    clock_.outside([&] {
      pollfd ready{dc1394_capture_get_fileno(camera_.get()), POLLIN, 0};
      ::poll(&ready, 1,
             static_cast<int>(std::chrono::ceil<std::chrono::milliseconds>(timeout).count()));
    });
  }

  /// Of the frames that wait in the ring, the last one that is whole. A ring that was full holds
  /// the first frames since then, not the last ones: none of these is the newest.
  std::optional<Frame> newest() {
    std::optional<Frame> latest;
    unsigned taken = 0;
    for (; taken < kBuffers; ++taken) {
      dc1394video_frame_t* raw = nullptr;
      if (dc1394_capture_dequeue(camera_.get(), DC1394_CAPTURE_POLICY_POLL, &raw) !=
          DC1394_SUCCESS) {
        lost_ = true;
        fail(DeviceErrorKind::lost, "its frames cannot be read");
      }
      if (raw == nullptr) break;
      heard_ = clock_.now();
      // The image is copied in there, for the ring's buffer goes back to the kernel.
      latest = frame_of(*raw);
      // Cameras on USB tell; on FireWire libdc1394 never does (docs/instruments.md).
      if (dc1394_capture_is_frame_corrupt(camera_.get(), raw) == DC1394_TRUE) {
        ++statistics_.torn;
        --statistics_.delivered;
        latest.reset();
      }
      dc1394_capture_enqueue(camera_.get(), raw);
    }
    if (taken == kBuffers) latest.reset();
    return latest;
  }

  // The time stamp is the wall clock's (in us) when the first packet came, which is when the
  // exposure ended; 0: not known.
  Frame frame_of(const dc1394video_frame_t& raw) {
    using Clocks = std::chrono::system_clock;
    const Time now = clock_.now();
    Time first = now - from_seconds(transfer_);
    if (raw.timestamp != 0)
      first = now - std::max(Time::zero(),
                             std::chrono::duration_cast<Time>(Clocks::now().time_since_epoch()) -
                                 Time(std::chrono::microseconds(raw.timestamp)));
    count(first);
    const cv::Mat image(static_cast<int>(raw.size[1]), static_cast<int>(raw.size[0]), CV_8U,
                        raw.image, raw.stride);
    return {image.clone(), number_, first - from_seconds(exposure_ / 2),
            std::min(now, first + from_seconds(transfer_))};
  }

  /// IIDC numbers no frames: those that did not come show by their time. The period is the stated
  /// one unless the camera never was that fast.
  void count(Time first) {
    if (statistics_.delivered++ != 0) {
      const double passed = to_seconds(first - last_);
      shortest_ = std::min(shortest_, passed);
      const double period = std::max(info_.frame_period, shortest_);
      const auto steps =
          static_cast<std::uint64_t>(std::max<std::int64_t>(1, std::llround(passed / period)));
      number_ += steps;
      statistics_.lost += steps - 1;
    }
    last_ = first;
  }

  const Settings settings_;
  Clock& clock_;
  std::unique_ptr<dc1394_t, decltype(&dc1394_free)> library_;
  std::unique_ptr<dc1394camera_t, decltype(&dc1394_camera_free)> camera_;
  std::unique_ptr<dc1394camera_t, decltype(&stop)> running_;  ///< with its ring
  CameraInfo info_;
  CameraStatistics statistics_;
  double exposure_ = 0;    ///< s, as the camera has it
  double transfer_ = 0;    ///< s from the first to the last packet of a frame
  double shortest_ = 1e9;  ///< s between two frames so far
  std::uint64_t number_ = 0;
  Time last_{};  ///< the first packet of the frame before
  Time heard_{};
  bool lost_ = false;
};

}  // namespace

std::string why_not() { return ""; }
std::unique_ptr<Camera> open(const Settings& settings, Clock& clock) {
  settings.check();
  return std::make_unique<IidcCamera>(settings, clock);
}

#endif

}  // namespace vitreo::iidc
