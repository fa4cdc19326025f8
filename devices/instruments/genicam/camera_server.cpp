// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/genicam/camera_server.h"

#include "devices/instruments/genicam/aravis.h"
#include "devices/time/error.h"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <mutex>
#include <stdexcept>
#include <utility>

namespace vitreo::genicam {
namespace {

/// Aravis' fake camera (ArvGvFakeCamera): its registers and its stream, our images. It never
/// answers a request to resend a packet, and now and then stalls for 100 ms.
class FakeCameraServer final : public CameraServer {
 public:
  // GigE Vision cameras are found at port 3956 of their address, so there is one server an
  // interface.
  FakeCameraServer(const ServerSettings& settings, Draw draw)
      : draw_(std::move(draw)),
        camera_(arv_gv_fake_camera_new(settings.interface.c_str(), settings.serial.c_str())) {
    if (!camera_ || arv_gv_fake_camera_is_running(camera_.get()) == FALSE)
      throw DeviceError(DeviceErrorKind::refused, "camera server",
                        "no GigE Vision camera can be offered on " + settings.interface +
                            ": there is no such interface, or its port 3956 is taken");
    ArvFakeCamera* const fake = arv_gv_fake_camera_get_fake_camera(camera_.get());
    arv_fake_camera_write_register(fake, ARV_FAKE_CAMERA_REGISTER_WIDTH,
                                   static_cast<guint32>(settings.width_px));
    arv_fake_camera_write_register(fake, ARV_FAKE_CAMERA_REGISTER_HEIGHT,
                                   static_cast<guint32>(settings.height_px));
    arv_fake_camera_set_fill_pattern(fake, on_fill, this);
    faults_.lost_packets = settings.lost_packets;
  }
  FakeCameraServer(const FakeCameraServer&) = delete;
  FakeCameraServer& operator=(const FakeCameraServer&) = delete;
  // Its thread may hang in fill().
  ~FakeCameraServer() override {
    {
      const std::lock_guard lock(mutex_);
      ending_ = true;
    }
    changed_.notify_all();
  }
  std::uint64_t exposures() const override { return exposures_; }
  void set_faults(const ServerFaults& faults) override {
    faults.check();
    {
      const std::lock_guard lock(mutex_);
      faults_ = faults;
    }
    changed_.notify_all();
  }

 private:
  static void on_fill(ArvBuffer* buffer, void* self, guint32 exposure_us, guint32,
                      ArvPixelFormat format) {
    static_cast<FakeCameraServer*>(self)->fill(buffer, exposure_us * 1e-6, format);
  }
  /// Called by the fake camera's thread, for each frame that it is about to send.
  /// Draws straight into the buffer that Aravis sends; the exposure is what the client has set, s.
  void fill(ArvBuffer* buffer, double exposure, ArvPixelFormat format) {
    const int width = arv_buffer_get_image_width(buffer);
    const int height = arv_buffer_get_image_height(buffer);
    // The size that comes with the data is that of what was received, which here is nothing yet.
    void* const pixels = const_cast<void*>(arv_buffer_get_data(buffer, nullptr));
    // Of another format this server has no image: the client gets what was in the buffer.
    if (format != ARV_PIXEL_FORMAT_MONO_8 || width < 1 || height < 1) return;
    cv::Mat image(height, width, CV_8U, pixels);
    const std::uint64_t number = exposures_++;
    const ServerFaults faults = faults_of(number);
    if (faults.frozen && last_.size() == image.size()) return last_.copyTo(image);
    draw_({number, exposure, faults.late}, image);
    image.copyTo(last_);
    if (faults.late > 0)  // its own clock tells when it was exposed
      arv_buffer_set_timestamp(
          buffer, arv_buffer_get_timestamp(buffer) - static_cast<guint64>(faults.late * 1e9));
  }

  /// While it hangs this waits, and with it the one thread that also answers the client.
  ServerFaults faults_of(std::uint64_t number) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return ending_ || !faults_.silent; });
    // Not while the camera ends: an object must not be touched that is given up.
    if (!ending_) g_object_set(camera_.get(), "gvsp-lost-ratio", lost_of(faults_, number), nullptr);
    return faults_;
  }
  /// Part of the packets of one image that are not sent.
  static double lost_of(const ServerFaults& faults, std::uint64_t number) {
    constexpr double kTorn = 0.2;
    const auto is_one_of = [number](int each) {
      return each > 0 && number % static_cast<std::uint64_t>(each) == 0;
    };
    if (is_one_of(faults.drops)) return 1;
    return is_one_of(faults.torn) ? std::max(kTorn, faults.lost_packets) : faults.lost_packets;
  }

  Draw draw_;
  std::atomic<std::uint64_t> exposures_{0};
  cv::Mat last_;  // of the camera's thread
  std::mutex mutex_;
  std::condition_variable changed_;
  ServerFaults faults_;  // and ending_: of any thread, under mutex_
  bool ending_ = false;
  Object<ArvGvFakeCamera> camera_;  // last: its thread draws until it is gone
};

}  // namespace

void ServerSettings::check() const {
  if (interface.empty()) throw std::invalid_argument("interface: must not be empty");
  if (width_px < 1 || width_px > 2048)
    throw std::invalid_argument("width_px: must be in [1, 2048]");
  if (height_px < 1 || height_px > 2048)
    throw std::invalid_argument("height_px: must be in [1, 2048]");
  if (!(lost_packets >= 0 && lost_packets <= 1))
    throw std::invalid_argument("lost_packets: must be in [0, 1]");
}

void ServerFaults::check() const {
  if (!(late >= 0 && late <= 0.9)) throw std::invalid_argument("late: must be in [0, 0.9] s");
  if (drops < 0) throw std::invalid_argument("drops: must not be negative");
  if (torn < 0) throw std::invalid_argument("torn: must not be negative");
  if (!(lost_packets >= 0 && lost_packets <= 1))
    throw std::invalid_argument("lost_packets: must be in [0, 1]");
}

std::unique_ptr<CameraServer> serve_camera(const ServerSettings& settings, Draw draw) {
  settings.check();
  if (!draw) throw std::invalid_argument("draw: must not be empty");
  return std::make_unique<FakeCameraServer>(settings, std::move(draw));
}

}  // namespace vitreo::genicam
