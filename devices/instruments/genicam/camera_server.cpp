// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/genicam/camera_server.h"

#include "devices/instruments/genicam/aravis.h"
#include "devices/time/error.h"

#include <atomic>
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
    if (settings.lost_packets > 0)
      g_object_set(camera_.get(), "gvsp-lost-ratio", settings.lost_packets, nullptr);
  }
  std::uint64_t exposures() const override { return exposures_; }

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
    draw_({exposures_++, exposure}, image);
  }

  Draw draw_;
  std::atomic<std::uint64_t> exposures_{0};
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

std::unique_ptr<CameraServer> serve_camera(const ServerSettings& settings, Draw draw) {
  settings.check();
  if (!draw) throw std::invalid_argument("draw: must not be empty");
  return std::make_unique<FakeCameraServer>(settings, std::move(draw));
}

}  // namespace vitreo::genicam
