// Injected faults of the simulated instruments. The session sets them; the instruments, and the
// links to their emulators, read them at each use, all under the clock's baton.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/time/clock.h"

#include <functional>
#include <limits>
#include <map>
#include <set>
#include <string>

namespace vitreo::sim {

/// Faults of a camera's pictures.
struct PictureFaults {
  /// factor of the light; above the sensor's range the picture is white
  double light = 1;
  int blur_px = 0;        ///< radius of the disc into which a point is smeared
  int floater_px = 0;     ///< radius of a dark speck that drifts through the picture; 0: none
  Time floater_since{};   ///< when it came in
  int shift_px = 0;       ///< the camera was knocked: all of it is so far to the right
  double turned = 0;      ///< rad, about the picture's middle: the camera was turned
  bool mirrored = false;  ///< left is right
};

/// Faults of an imaging device: a camera, or the pose sensor.
struct ImagingFaults {
  bool unplugged = false;    ///< every call throws DeviceError{lost}
  bool silent = false;       ///< nothing comes
  bool frozen = false;       ///< the last picture, or position, again and again under new numbers
  bool alternating = false;  ///< the last two, one after the other, again and again
  bool stale = false;        ///< the last one again and again, with noise of its own each time
  bool nan = false;          ///< positions that are not numbers; of the pose sensor
  Time late{};               ///< how much later it comes
  Time jump{};               ///< how wrong the time stamps of the exposures are
  double drift = 0;          ///< s/s, by which that grows from `drift_since` on
  Time drift_since{};
  int drops = 0;  ///< each n-th never comes; 0: all come
  int torn = 0;   ///< each n-th comes in part, and is dropped and counted
  /// How wrong the stamp of an exposure at `exposed` is.
  Time stamp_error(Time exposed) const {
    if (drift == 0) return jump;
    return jump + std::chrono::duration_cast<Time>(drift * (exposed - drift_since));
  }
  PictureFaults picture;  ///< of a camera
};

/// Faults of a motor.
struct MotionFaults {
  bool stuck = false;  ///< it stands still when it is commanded to move
  bool limit = false;  ///< its limit switch is pressed: it stops, and does not set off
};

struct Faults {
  std::map<std::string, LinkFaults> links;  // by role; of the instruments behind an emulated wire
  std::map<std::string, ImagingFaults> looks;  // top_camera, side_camera, pose_sensor
  MotionFaults lens;                           // of the lens mover's motor
  /// By role: holds a stage where it is, or lets it go; the emulators that know how put theirs here
  /// when they are opened.
  std::map<std::string, std::function<void(bool held, Time now)>> sticks;
  std::set<int> cut_off;  // channels from 1 whose amplifier gives no current
  // A: the largest current of the amplifiers
  double saturation = std::numeric_limits<double>::infinity();
  /// By channel from 1: part of the current that makes field; a shorted coil 0, one whose leads are
  /// exchanged -1. Of the others all of it does.
  std::map<int, double> coil_response;
};

}  // namespace vitreo::sim
