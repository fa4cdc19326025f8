// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/opencv_camera/driver.h"

#include "devices/instruments/opencv_camera/v4l2_controls.h"
#include "devices/roles/gray.h"
#include "devices/time/error.h"

#include <opencv2/videoio.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <stdexcept>
#include <utility>

namespace vitreo::opencv_camera {
namespace {

/// s after which a camera is lost.
constexpr double kSilence = 0.45;
/// Hz: of a file that does not say.
constexpr double kUnknownRate = 15;
/// Hz; more is found only in broken headers.
constexpr double kFastest = 1e4;

/// A file is exposed at its own pace, frame by frame; a camera delivers when it does, and the
/// frames in between are estimated from the time that has passed.
class OpencvCamera final : public Camera {
 public:
  // What has a name below /dev is a camera, everything else a file.
  OpencvCamera(const Settings& settings, Clock& clock)
      : settings_(settings), clock_(clock), live_(is_node(settings.source)) {
    if (!std::filesystem::exists(settings_.source))
      fail(DeviceErrorKind::not_found, "no such file or device");
    clock_.outside([this] { start(); });
    begin_ = clock_.now();
  }
  OpencvCamera(const OpencvCamera&) = delete;
  OpencvCamera& operator=(const OpencvCamera&) = delete;
  ~OpencvCamera() override {
    clock_.outside([this] { capture_.release(); });
  }
  const CameraInfo& info() const override { return info_; }
  CameraStatistics statistics() const override { return statistics_; }
  Frame grab(Time timeout) override { return live_ ? grab_live(timeout) : grab_of_file(timeout); }

 private:
  [[noreturn]] void fail(DeviceErrorKind kind, const std::string& what) const {
    throw DeviceError(kind, settings_.name, settings_.source + ": " + what);
  }

  /// The back ends are named: left to itself OpenCV tries one after the other, GStreamer among
  /// them. Exceptions are off, so that each failure is an error of ours.
  /// A header may state any rate: one that cannot be is replaced by kUnknownRate.
  void start() {
    capture_.setExceptionMode(false);
    if (!(live_ ? capture_.open(settings_.source, cv::CAP_V4L2)
                : capture_.open(settings_.source, cv::CAP_FFMPEG)))
      fail(DeviceErrorKind::not_found,
           live_ ? "is no camera, or is in use" : "is no video that can be read");
    if (live_) configure();
    double rate = capture_.get(cv::CAP_PROP_FPS);
    if (!live_ && settings_.frame_rate > 0) rate = settings_.frame_rate;
    if (!(rate > 0 && rate <= kFastest)) rate = kUnknownRate;
    info_.identity = (live_ ? "UVC camera " : "video file ") + settings_.source;
    info_.width_px = static_cast<int>(std::lround(capture_.get(cv::CAP_PROP_FRAME_WIDTH)));
    info_.height_px = static_cast<int>(std::lround(capture_.get(cv::CAP_PROP_FRAME_HEIGHT)));
    info_.frame_period = 1 / rate;
    info_.effective_pixel = settings_.effective_pixel;
    period_ = from_seconds(1 / rate);
  }

  /// OpenCV keeps a width to itself until a height is set too, and then makes both.
  void set_size() {
    if (settings_.width_px == 0 && settings_.height_px == 0) return;
    const auto wanted = [this](int value, int property) {
      return value != 0 ? value : capture_.get(property);
    };
    const double width = wanted(settings_.width_px, cv::CAP_PROP_FRAME_WIDTH);
    const double height = wanted(settings_.height_px, cv::CAP_PROP_FRAME_HEIGHT);
    capture_.set(cv::CAP_PROP_FRAME_WIDTH, width);
    capture_.set(cv::CAP_PROP_FRAME_HEIGHT, height);
  }

  /// V4L2 takes the nearest setting in silence: each is read back.
  void configure() {
    set_size();
    // A setting of 0 is left to the camera. A twentieth off is accepted: 30 Hz may be 29.97.
    const auto want = [this](int property, double value, const char* setting) {
      if (value == 0) return;
      capture_.set(property, value);
      if (std::abs(capture_.get(property) - value) > 0.05 * value)
        fail(DeviceErrorKind::refused, std::string(setting) + ": it gives " +
                                           std::to_string(capture_.get(property)) + " instead of " +
                                           std::to_string(value));
    };
    want(cv::CAP_PROP_FRAME_WIDTH, settings_.width_px, "width_px");
    want(cv::CAP_PROP_FRAME_HEIGHT, settings_.height_px, "height_px");
    want(cv::CAP_PROP_FPS, settings_.frame_rate, "frame_rate");
    set_light();
    // Of a queue of old frames only the newest would count.
    capture_.set(cv::CAP_PROP_BUFFERSIZE, 2);
    const double rate = std::max(capture_.get(cv::CAP_PROP_FPS), 1.);
    capture_.set(cv::CAP_PROP_READ_TIMEOUT_MSEC, 1e3 * std::max(kSilence, 5 / rate));
  }

  /// What was left automatic in a camera changes the picture in mid-run.
  void set_light() {
    if (settings_.exposure == 0 && !settings_.gain) return;
    const V4l2Controls controls(settings_.source, settings_.name);
    controls.switch_automatics_off();
    if (settings_.exposure > 0) exposure_ = from_seconds(controls.set_exposure(settings_.exposure));
    if (settings_.gain) controls.set_gain(*settings_.gain);
    info_.settings = {{"exposure", std::to_string(to_seconds(exposure_)) + " s"}};
    if (settings_.gain) info_.settings.emplace_back("gain", std::to_string(*settings_.gain));
  }

  /// How long ago the driver had the image, by V4L2's stamp of CLOCK_MONOTONIC; a driver whose
  /// stamps lie ahead, or that has none, is taken for prompt.
  Time age() const {
    const double stamped_ms = capture_.get(cv::CAP_PROP_POS_MSEC);
    const double now_ms = std::chrono::duration<double, std::milli>(
                              std::chrono::steady_clock::now().time_since_epoch())
                              .count();
    const double age = (now_ms - stamped_ms) * 1e-3;
    return stamped_ms > 0 && age > 0 && age < 1 ? from_seconds(age) : Time::zero();
  }

  /// One image, or an empty one at the end or when none comes.
  /// Outside the baton, for it blocks until a frame has come, or for the read timeout.
  cv::Mat read() {
    cv::Mat image;
    clock_.outside([&] {
      if (!capture_.read(image)) image.release();
    });
    return image;
  }
  /// `number` counts exposures from 0. The size is that of the opening: a stream that changes it is
  /// broken.
  Frame frame_of(const cv::Mat& image, std::int64_t number, Time exposed) {
    if (image.cols != info_.width_px || image.rows != info_.height_px) {
      ++statistics_.torn;
      fail(DeviceErrorKind::protocol, "an image of another size came");
    }
    ++statistics_.delivered;
    last_ = number;
    return {in_gray(image), static_cast<std::uint64_t>(number), exposed,
            std::max(exposed, clock_.now())};
  }

  /// The next frame, at its time; none is dropped, however late the call is.
  Frame grab_of_file(Time timeout) {
    const Time exposed = begin_ + (last_ + 1) * period_;
    const Time deadline = later(clock_.now(), timeout);
    if (exposed > deadline) {
      clock_.sleep_until(deadline);
      fail(DeviceErrorKind::timeout, "no frame in time");
    }
    clock_.sleep_until(exposed);
    const cv::Mat image = read();
    if (image.empty()) fail(DeviceErrorKind::lost, "the video is over");
    return frame_of(image, last_ + 1, exposed);
  }

  /// V4L2 knows one deadline, that of the camera's silence: a shorter `timeout` is noticed when the
  /// frame has come.
  Frame grab_live(Time timeout) {
    const Time start = clock_.now();
    const cv::Mat image = read();  // the read timeout set above is the deadline that V4L2 knows
    const Time now = clock_.now();
    if (image.empty()) {
      clock_.sleep_until(now);  // a stop comes through here
      fail(DeviceErrorKind::lost, "the camera has fallen silent");
    }
    // Periods since the last frame, rounded: the camera has no numbers of its own.
    const auto passed =
        // A frame that is late by less than half a period is the next one, not the one after.
        last_ < 0 ? 1 : std::max<std::int64_t>(1, (now - heard_ + period_ / 2) / period_);
    statistics_.lost += static_cast<std::uint64_t>(passed - 1);
    heard_ = now;
    Frame frame = frame_of(image, last_ + passed, now - age() - exposure_ / 2);
    if (now - start > timeout) fail(DeviceErrorKind::timeout, "no frame in time");
    return frame;
  }

  const Settings settings_;
  Clock& clock_;
  const bool live_;
  cv::VideoCapture capture_;
  CameraInfo info_;
  Time begin_{};
  Time heard_{};
  Time period_{};
  Time exposure_{};  // as the camera read it back; zero: not set
  std::int64_t last_ = -1;
  CameraStatistics statistics_;
};

}  // namespace

void Settings::check() const {
  if (name.empty()) throw std::invalid_argument("name: must not be empty");
  if (source.empty()) throw std::invalid_argument("source: must not be empty");
  if (width_px < 0 || height_px < 0)
    throw std::invalid_argument("width_px, height_px: must not be negative");
  if (!(frame_rate >= 0 && frame_rate <= kFastest))
    throw std::invalid_argument("frame_rate: must be in [0, 1e4] Hz");
  if (!(exposure >= 0 && exposure <= 100))
    throw std::invalid_argument("exposure: must be in [0, 100] s");
  if (!(effective_pixel > 0 && effective_pixel < 1))
    throw std::invalid_argument("effective_pixel: must be in (0, 1) m");
}

bool is_node(const std::string& source) { return source.starts_with("/dev/"); }

std::unique_ptr<Camera> open(const Settings& settings, Clock& clock) {
  settings.check();
  return std::make_unique<OpencvCamera>(settings, clock);
}

}  // namespace vitreo::opencv_camera
