// Driver of GenICam cameras by Aravis: GigE Vision, and USB3 Vision (compiled, but never proven
// without a camera at hand).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/camera.h"
#include "devices/time/clock.h"

#include <memory>
#include <string>
#include <vector>

namespace vitreo::genicam {

struct Settings {
  std::string name = "camera";  ///< in errors
  /// Its identity as list_cameras() shows it, or its IP address; empty: the first found.
  std::string camera{};
  int width_px = 640;
  int height_px = 480;
  double frame_rate = 60;          ///< Hz
  double exposure = 5e-3;          ///< s
  double gain = 0;                 ///< in the camera's unit, mostly dB
  double effective_pixel = 20e-6;  ///< m of the observed plane per pixel
  /// Bytes of a GigE Vision packet; jumbo frames (8000) where the network has them.
  int packet_size = 1400;
  /// Bytes. The kernel's default loses nearly every frame on a loaded machine; sysctl
  /// net.core.rmem_max bounds it.
  int socket_buffer = 4 << 20;
  void check() const;  ///< throws std::invalid_argument naming the setting
};

/// Opens the camera, applies the settings, reads them back and starts it. Throws
/// DeviceError{not_found}, {refused} (another program controls it, or it does not take a setting;
/// it is named), {lost}. A frame's `exposed` is the arrival of its first packet less half the
/// exposure: a camera's clock is its own. grab() throws DeviceError{lost} when the camera has been
/// silent for 0.45 s or five frames, whatever is longer. A camera that was lost stays lost: open it
/// again. Destruction blocks up to 5 s then, on the clock's outside().
std::unique_ptr<Camera> open(const Settings& settings, Clock& clock);

struct Found {
  std::string identity;
  std::string vendor;
  std::string model;
  std::string serial;
  std::string address;
  std::string protocol;
};
/// Asks every network interface and the USB, which takes a second.
std::vector<Found> list_cameras();

}  // namespace vitreo::genicam
