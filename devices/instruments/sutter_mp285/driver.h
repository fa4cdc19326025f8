// Driver of the Sutter MP-285 and MP-285A: a micromanipulator of three axes, on a serial port.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/roles/stage.h"
#include "devices/time/clock.h"

#include <array>
#include <memory>
#include <string>

namespace vitreo::sutter_mp285 {

struct Settings {
  std::string name = "stage";  ///< in errors
  /// m, from the origin: 25 mm of travel about the factory's.
  std::array<double, 3> travel_min{-12.5e-3, -12.5e-3, -12.5e-3};
  std::array<double, 3> travel_max{12.5e-3, 12.5e-3, 12.5e-3};
  double max_speed = 3e-3;  ///< m/s; above 1.31 mm/s it steps coarsely, by 0.2 um
  double speed = 1e-3;      ///< m/s
  /// s: opening the port toggles its lines, and the controller starts anew (acq4 waits 1 s).
  double opening_pause = 1.0;
  /// s, of everything but a motion. acq4 allows it 5 to 10 s, and an answer that is not waited for
  /// must be answered by an interrupt, which locks an MP-285A up (navigate).
  double reply_timeout = 5;
  void check() const;  ///< throws std::invalid_argument naming the setting
};

/// Opens the controller, with what moves stopped; absolute positions from wherever its origin was
/// set. Throws DeviceError{not_found} when it is no MP-285. During a motion nothing is sent, since
/// any byte would end it: position() is an estimate then, and the silence of a controller is
/// noticed when the motion should have ended. home() is refused: it has no reference. Destruction
/// stops it.
std::unique_ptr<Stage> open(std::unique_ptr<ByteLink> link, const Settings& settings, Clock& clock);

}  // namespace vitreo::sutter_mp285
