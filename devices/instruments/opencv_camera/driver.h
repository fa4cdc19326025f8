// Driver of UVC cameras (V4L2) and video files by OpenCV's videoio.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/camera.h"
#include "devices/time/clock.h"

#include <memory>
#include <optional>
#include <string>

namespace vitreo::opencv_camera {

struct Settings {
  std::string name = "camera";     ///< in errors
  std::string source;              ///< /dev/videoN, or a video file
  int width_px = 0;                ///< of a UVC camera; 0: as it comes
  int height_px = 0;               ///< likewise
  double frame_rate = 0;           ///< Hz; 0: as it comes (15 Hz for a file that does not say)
  double exposure = 0;             ///< s, of a UVC camera, to 100 us; 0: as it comes
  std::optional<int> gain{};       ///< likewise, in the camera's unit; nothing: as it comes
  double effective_pixel = 20e-6;  ///< m of the observed plane per pixel
  void check() const;              ///< throws std::invalid_argument naming the setting
};

/// Whether `source` is the node of a camera and not a file.
bool is_node(const std::string& source);

/// A file plays every frame, at its rate; grab() throws {lost} at its end. Throws
/// DeviceError{not_found}, {refused} when a camera does not take size, rate, exposure or gain. A
/// camera that stops sending is noticed after 0.45 s or five frames. `exposed` is the driver's
/// stamp of the image (V4L2, the machine's steady clock; of a UVC camera it wanders by
/// milliseconds) less half the exposure, where that is set.
std::unique_ptr<Camera> open(const Settings& settings, Clock& clock);

}  // namespace vitreo::opencv_camera
