// Driver of FireWire cameras by the IIDC (DCAM) standard and libdc1394: the Basler A602f and the
// Point Grey Grasshopper of the thesis. Optional. There is no emulator: it is run against a double
// of a camera behind libdc1394, and was never run with a camera.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/camera.h"
#include "devices/time/clock.h"

#include <memory>
#include <string>

namespace vitreo::iidc {

struct Settings {
  std::string name = "camera";  ///< in errors
  std::string guid{};           ///< 16 hexadecimal digits, as on the camera; empty: the only one
  int width_px = 640;           ///< of a region of Format 7, mode 0, in the sensor's middle
  int height_px = 480;          ///< likewise
  double frame_rate = 60;       ///< Hz; the bus' packets are chosen for it
  double exposure = 5e-3;       ///< s
  /// s of one count of the shutter's register, from the camera's manual: for a camera that has no
  /// absolute control of it (Basler A600f and A620f: 20e-6). 0: by absolute control, in s.
  double shutter_unit = 0;
  double gain = 0;                 ///< dB, or counts where the camera has no absolute control
  double effective_pixel = 20e-6;  ///< m of the observed plane per pixel
  bool fast_bus = false;           ///< IEEE 1394b, 800 Mbit/s
  void check() const;              ///< throws std::invalid_argument naming the setting
};

/// Why no camera can be opened by this program; empty where it was built with libdc1394.
std::string why_not();

/// Opens the camera and starts it, free-running, with nothing automatic. Throws
/// DeviceError{not_found}, {refused} naming the setting that it does not take or does not keep. The
/// frame period is the camera's own, at most 1 / frame_rate unless the exposure takes longer. A
/// frame's number counts what its time says that the camera took. grab() throws DeviceError{lost}
/// after 0.45 s or five frames of silence, whatever is longer; it stays lost then.
std::unique_ptr<Camera> open(const Settings& settings, Clock& clock);

}  // namespace vitreo::iidc
