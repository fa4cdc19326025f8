// Driver of GenICam cameras by Aravis: GigE Vision, and USB3 Vision (compiled, but never proven
// without a camera at hand).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/camera.h"
#include "devices/time/clock.h"

#include <memory>
#include <string>
#include <utility>
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
  int offset_x_px = 0;             ///< of the image's first pixel on the sensor
  int offset_y_px = 0;
  std::string pixel_format = "Mono8";  ///< one of pixel_formats()
  /// Loaded before all else, so that a camera does not bring what was left in it; empty: not.
  std::string user_set = "Default";
  /// Its source: "Software", "Line1"; empty: free running. `frame_rate` is then the rate expected.
  std::string trigger{};
  std::string trigger_edge = "rising";  ///< or "falling"
  double trigger_delay = 0;             ///< s, from the edge to the begin of the exposure
  std::string exposure_output{};  ///< a line that is high while the camera exposes; empty: none
  /// Set last, in this order; to a command the empty text.
  std::vector<std::pair<std::string, std::string>> features{};
  /// By which a frame is dated: "latch" of the camera's clock, where it has one, "arrivals" alone
  /// of what that clock has stamped, or "none" of it.
  std::string device_clock = "latch";
  bool stamps_the_end = false;  ///< its time stamp is of the exposure's end, not of its begin
  /// Whether each frame says itself when, and for how long, it was exposed: "auto" where the camera
  /// has chunk data and its images keep their size with them, "on", "off".
  std::string chunks = "auto";
  /// Its clock follows a master on the network (IEEE 1588); opening waits until it does.
  bool ptp = false;
  double ptp_timeout = 15;  ///< s
  /// s, from the end of the exposure to the first packet; by data sheet, or by a lamp that is
  /// switched.
  double readout = 0;
  /// Bytes of a GigE Vision packet; jumbo frames (8000) where the network has them.
  int packet_size = 1400;
  /// Bytes. The kernel's default loses nearly every frame on a loaded machine; sysctl
  /// net.core.rmem_max bounds it.
  int socket_buffer = 4 << 20;
  void check() const;  ///< throws std::invalid_argument naming the setting
};

/// Opens the camera, applies the settings, reads them back and starts it. Throws
/// DeviceError{not_found}, {refused} (another program controls it, or it does not take a setting;
/// it is named), {lost}.
///
/// Automatic exposure, gain and white balance are switched off, gamma is 1, triggers are off unless
/// they are asked for. Begin and length of a frame's exposure are those of its chunk data where it
/// has such, else its leader's stamp and the exposure that was read back last. A frame's `exposed`
/// is by the camera's own clock where it has one: by latch (the camera is asked for its time once a
/// second, and the exposure is where the stamp says), else by the earliest of its arrivals, which
/// is the end of the exposure and `readout`. A camera without a clock: by each arrival.
///
/// grab() throws DeviceError{lost} when the camera has been silent for 0.45 s or five frames,
/// whatever is longer; one that waits for a trigger may be silent. A camera that was lost stays
/// lost: open it again. Destruction blocks up to 5 s then, on the clock's outside().
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
