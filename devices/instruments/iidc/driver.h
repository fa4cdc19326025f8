// Driver of FireWire cameras by the IIDC (DCAM) standard and libdc1394: the Basler A602f and the
// Point Grey Grasshopper of the thesis. Optional, and compiled only: there is no emulator for
// FireWire, so it was never run with a camera.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/camera.h"
#include "devices/time/clock.h"

#include <memory>
#include <string>

namespace vitreo::iidc {

struct Settings {
  std::string name = "camera";     ///< in errors
  std::string guid{};              ///< 16 hexadecimal digits, as on the camera; empty: the only one
  int width_px = 640;              ///< of a region of Format 7, mode 0, in the sensor's middle
  int height_px = 480;             ///< likewise
  double frame_rate = 60;          ///< Hz; the bus' packets are chosen for it
  double exposure = 5e-3;          ///< s
  double gain = 0;                 ///< in the camera's unit, mostly dB
  double effective_pixel = 20e-6;  ///< m of the observed plane per pixel
  bool fast_bus = false;           ///< IEEE 1394b, 800 Mbit/s
  void check() const;              ///< throws std::invalid_argument naming the setting
};

/// Why no camera can be opened by this program; empty where it was built with libdc1394.
std::string why_not();

/// Opens the camera and starts it. Throws DeviceError{not_found}, {refused} naming the setting that
/// it does not take. grab() throws DeviceError{lost} after 0.45 s or five frames of silence,
/// whatever is longer; it stays lost then.
std::unique_ptr<Camera> open(const Settings& settings, Clock& clock);

}  // namespace vitreo::iidc
