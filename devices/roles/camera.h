// The role of a camera: time-stamped images, one after the other.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace vitreo {

/// One image. The first pixel's center is (0, 0); u goes right, v goes down.
struct Frame {
  /// 8-bit gray, or blue, green, red of a color camera; never written to after delivery.
  cv::Mat image;
  std::uint64_t number = 0;  ///< counts exposures, so a gap shows dropped frames
  Time exposed{};            ///< the middle of the exposure
  Time received{};           ///< when the host had it
  /// The instrument's own clock at the middle of the exposure, where it has one; `exposed` is its
  /// image on the host's.
  std::optional<Time> device{};
};

struct CameraInfo {
  std::string identity;
  int width_px = 0;
  int height_px = 0;
  double frame_period = 0;  ///< s
  /// m of the observed plane (the aerial image for a microscope on the eye) per pixel.
  double effective_pixel = 0;
  /// What the camera itself said when it was opened, in its own names and units; for the record.
  std::vector<std::pair<std::string, std::string>> settings{};
};

/// Counts of frames since the camera was opened.
struct CameraStatistics {
  std::uint64_t delivered = 0;  ///< came whole, whether or not they were grabbed
  std::uint64_t lost = 0;       ///< exposed, by their numbers, but never came
  std::uint64_t torn = 0;       ///< came in part, and were dropped
};

class Camera {
 public:
  virtual ~Camera() = default;
  virtual const CameraInfo& info() const = 0;
  /// Waits for the newest frame that was not yet returned. Throws DeviceError{timeout} after
  /// `timeout`, {lost}; Stopped.
  virtual Frame grab(Time timeout) = 0;
  /// All zero where frames cannot get lost.
  virtual CameraStatistics statistics() const { return {}; }
};

}  // namespace vitreo
