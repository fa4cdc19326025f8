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
  /// Of a gray camera of more than 8 bits the same image with all of them, CV_16UC1, right-aligned;
  /// else empty. The record keeps this one.
  cv::Mat deep{};
  int bits = 8;  ///< that count of a pixel of `deep`, or of `image` where it is empty
};

struct CameraInfo {
  std::string identity;
  int width_px = 0;
  int height_px = 0;
  double frame_period = 0;  ///< s
  /// m of the observed plane (the aerial image for a microscope on the eye) per pixel.
  double effective_pixel = 0;
  int bits = 8;  ///< that count of a pixel (Frame::bits)
  /// px: where the image's first pixel is on the sensor.
  int offset_x_px = 0;
  int offset_y_px = 0;
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

  /// Settings by the names that the instrument gives them, as text in its units. Throw
  /// DeviceError{refused} naming the feature where there is none, or it does not take the value, or
  /// it decides what an image is and belongs to the rig file (its size, its format).
  virtual std::string feature(const std::string& name);
  /// Returns what the camera reads back; of a command, whose value is "", nothing
  /// ("TriggerSoftware": one exposure, of a camera that waits for a trigger by software).
  virtual std::string set_feature(const std::string& name, const std::string& value);
};

}  // namespace vitreo
