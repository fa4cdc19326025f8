// Driver of an image sequence: a folder of images that plays the role of a camera.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/camera.h"
#include "devices/time/clock.h"

#include <memory>
#include <string>
#include <vector>

namespace vitreo::image_sequence {

struct Settings {
  std::string name = "camera";  ///< in errors
  std::string folder;      ///< all its .png, .tif, .tiff, .jpg and .bmp files, in natural order
  double frame_rate = 15;  ///< Hz
  /// true: the next image waits for the next grab; false: play on like a camera, and drop what was
  /// not grabbed.
  bool every_frame = false;
  bool repeat = false;             ///< begin again after the last; else grab() throws {lost} there
  double effective_pixel = 20e-6;  ///< m of the observed plane per pixel
  void check() const;              ///< throws std::invalid_argument naming the setting
};

/// Images are turned into 8-bit gray (16-bit ones scaled, color weighted) when they are grabbed.
/// Throws DeviceError{not_found} without folder or images, {protocol} naming a file that is no
/// image or has another size.
std::unique_ptr<Camera> open(const Settings& settings, Clock& clock);

/// "frame2" before "frame10": digits compare as numbers, everything else by its bytes.
bool naturally_before(const std::string& a, const std::string& b);

}  // namespace vitreo::image_sequence
