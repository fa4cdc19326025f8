// Driver of IIDC cameras; the only file that includes libdc1394.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/iidc/driver.h"

#include "devices/time/error.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <stdexcept>
#include <utility>

#ifdef VITREO_HAVE_DC1394
#include <opencv2/core.hpp>

#include <chrono>
#include <dc1394/dc1394.h>
#include <optional>
#include <poll.h>
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
/// Isochronous cycles a second of IEEE 1394, each with one packet of the camera.
constexpr double kCycles = 8000;
/// Frames of the DMA ring.
constexpr unsigned kBuffers = 8;
/// Format 7 is the one of free regions; its mode 0 has the sensor's full resolution.
constexpr dc1394video_mode_t kMode = DC1394_VIDEO_MODE_FORMAT7_0;
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
        camera_(nullptr, dc1394_camera_free) {
    clock_.outside([this] { start(); });
    heard_ = clock_.now();
  }
  IidcCamera(const IidcCamera&) = delete;
  IidcCamera& operator=(const IidcCamera&) = delete;
  ~IidcCamera() override {
    clock_.outside([this] {
      dc1394_video_set_transmission(camera_.get(), DC1394_OFF);
      dc1394_capture_stop(camera_.get());
    });
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
      if (to_seconds(now - heard_) > std::max(kSilence, 5 / settings_.frame_rate)) {
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
  /// libdc1394's error, under the name of the setting.
  void need(dc1394error_t code, const char* setting) const {
    if (code != DC1394_SUCCESS)
      fail(DeviceErrorKind::refused, std::string(setting) + ": " + dc1394_error_get_string(code));
  }

  // The order is libdc1394's: bus speed, mode, region, features, then the ring, and transmission
  // last.
  void start() {
    library_.reset(dc1394_new());
    if (!library_) fail(DeviceErrorKind::not_found, "there is no FireWire bus");
    camera_.reset(dc1394_camera_new(library_.get(), guid()));
    if (!camera_) fail(DeviceErrorKind::not_found, "it does not answer, or another program has it");
    if (settings_.fast_bus)
      need(dc1394_video_set_operation_mode(camera_.get(), DC1394_OPERATION_MODE_1394B), "fast_bus");
    need(dc1394_video_set_iso_speed(
             camera_.get(), settings_.fast_bus ? DC1394_ISO_SPEED_800 : DC1394_ISO_SPEED_400),
         "fast_bus");
    need(dc1394_video_set_mode(camera_.get(), kMode), "Format 7, mode 0");
    set_region();
    apply_feature(DC1394_FEATURE_SHUTTER, settings_.exposure, "exposure");
    apply_feature(DC1394_FEATURE_GAIN, settings_.gain, "gain");
    need(dc1394_capture_setup(camera_.get(), kBuffers, DC1394_CAPTURE_FLAGS_DEFAULT),
         "the DMA ring");
    need(dc1394_video_set_transmission(camera_.get(), DC1394_ON), "transmission");
    info_ = {std::string(camera_->vendor) + " " + camera_->model, settings_.width_px,
             settings_.height_px, 1 / settings_.frame_rate, settings_.effective_pixel};
  }

  /// The 64 bits by which a FireWire device is known, in any port.
  std::uint64_t guid() const {
    if (!settings_.guid.empty()) return std::stoull(settings_.guid, nullptr, 16);
    dc1394camera_list_t* found = nullptr;
    need(dc1394_camera_enumerate(library_.get(), &found), "looking for cameras");
    const std::unique_ptr<dc1394camera_list_t, decltype(&dc1394_camera_free_list)> list(
        found, dc1394_camera_free_list);
    if (list->num == 0) fail(DeviceErrorKind::not_found, "no FireWire camera is plugged in");
    if (list->num > 1) fail(DeviceErrorKind::not_found, "there are several; say which by its guid");
    return list->ids[0].guid;
  }

  /// In the sensor's middle. In Format 7 the packet's size sets the frame rate: bytes of an image
  /// times the rate, over 8000 packets a second, rounded up to the camera's unit.
  void set_region() {
    std::uint32_t width = 0;
    std::uint32_t height = 0;
    std::uint32_t unit = 0;
    std::uint32_t most = 0;
    need(dc1394_format7_get_max_image_size(camera_.get(), kMode, &width, &height), "width_px");
    const auto x = static_cast<std::uint32_t>(settings_.width_px);
    const auto y = static_cast<std::uint32_t>(settings_.height_px);
    if (x > width || y > height)
      fail(DeviceErrorKind::refused, "width_px, height_px: the sensor has " +
                                         std::to_string(width) + " x " + std::to_string(height));
    // Positions are multiples of a few pixels: 8 suits every camera.
    need(dc1394_format7_set_roi(camera_.get(), kMode, DC1394_COLOR_CODING_MONO8,
                                DC1394_USE_MAX_AVAIL,
                                static_cast<std::int32_t>((width - x) / 2 / 8 * 8),
                                static_cast<std::int32_t>((height - y) / 2 / 8 * 8),
                                settings_.width_px, settings_.height_px),
         "width_px, height_px");
    need(dc1394_format7_get_packet_parameters(camera_.get(), kMode, &unit, &most), "frame_rate");
    const double wanted = static_cast<double>(x) * y * settings_.frame_rate / kCycles;
    const auto packet =
        static_cast<std::uint32_t>(std::ceil(wanted / std::max(1U, unit))) * std::max(1U, unit);
    if (packet > most) fail(DeviceErrorKind::refused, "frame_rate: the bus cannot carry it");
    need(dc1394_format7_set_packet_size(camera_.get(), kMode, packet), "frame_rate");
  }

  /// By absolute values (s, dB). The Basler A620f and AVT's Guppy and Pike have none, and are
  /// refused here.
  void apply_feature(dc1394feature_t feature, double value, const char* setting) {
    need(dc1394_feature_set_mode(camera_.get(), feature, DC1394_FEATURE_MODE_MANUAL), setting);
    need(dc1394_feature_set_absolute_control(camera_.get(), feature, DC1394_ON), setting);
    need(dc1394_feature_set_absolute_value(camera_.get(), feature, static_cast<float>(value)),
         setting);
  }

  /// Until a frame is in the ring, outside the clock's baton.
  void wait(Time timeout) {
    clock_.outside([&] {
      pollfd ready{dc1394_capture_get_fileno(camera_.get()), POLLIN, 0};
      ::poll(&ready, 1,
             static_cast<int>(std::chrono::ceil<std::chrono::milliseconds>(timeout).count()));
    });
  }

  /// Of the frames that wait in the ring, the last one that is whole.
  /// At most once round the ring, so that a camera that is faster than this loop cannot hold it.
  std::optional<Frame> newest() {
    std::optional<Frame> latest;
    for (unsigned i = 0; i < kBuffers; ++i) {
      dc1394video_frame_t* raw = nullptr;
      if (dc1394_capture_dequeue(camera_.get(), DC1394_CAPTURE_POLICY_POLL, &raw) !=
          DC1394_SUCCESS) {
        lost_ = true;
        fail(DeviceErrorKind::lost, "its frames cannot be read");
      }
      if (raw == nullptr) break;
      heard_ = clock_.now();
      ++count_;
      if (dc1394_capture_is_frame_corrupt(camera_.get(), raw) == DC1394_TRUE)
        ++statistics_.torn;
      else
        // The image is copied in there, for the ring's buffer goes back to the kernel.
        latest = frame_of(*raw);
      dc1394_capture_enqueue(camera_.get(), raw);
    }
    return latest;
  }
  Frame frame_of(const dc1394video_frame_t& raw) {
    ++statistics_.delivered;
    // Its time stamp is the wall clock's (in us) when the last byte had come.
    using Clocks = std::chrono::system_clock;
    const Time age =
        std::max(Time::zero(), std::chrono::duration_cast<Time>(Clocks::now().time_since_epoch()) -
                                   Time(std::chrono::microseconds(raw.timestamp)));
    const Time received = clock_.now() - age;
    const cv::Mat image(static_cast<int>(raw.size[1]), static_cast<int>(raw.size[0]), CV_8U,
                        raw.image, raw.stride);
    return {image.clone(), count_ - 1, received - from_seconds(settings_.exposure / 2), received};
  }

  const Settings settings_;
  Clock& clock_;
  std::unique_ptr<dc1394_t, decltype(&dc1394_free)> library_;
  std::unique_ptr<dc1394camera_t, decltype(&dc1394_camera_free)> camera_;
  CameraInfo info_;
  CameraStatistics statistics_;
  std::uint64_t count_ = 0;
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
