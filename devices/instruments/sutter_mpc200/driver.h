// Driver of the Sutter MPC-200: a controller of up to four manipulators of three axes, on a virtual
// serial port of 128000 baud. It drives one of them, and sends nothing while that moves.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/roles/stage.h"
#include "devices/time/clock.h"

#include <array>
#include <memory>
#include <string>

namespace vitreo::sutter_mpc200 {

struct Settings {
  std::string name = "stage";                 ///< in errors
  int drive = 1;                              ///< 1 to 4: the manipulator that this stage is
  std::array<double, 3> travel_min{0, 0, 0};  ///< m, within 0 to 25 mm
  std::array<double, 3> travel_max{25e-3, 25e-3, 25e-3};  ///< m, likewise
  double max_speed = 2.77e-3;  ///< m/s; from 4.65 mm/s on its way is not straight
  double speed = 1e-3;         ///< m/s
  double reply_timeout = 0.5;  ///< s, of everything but a motion
  void check() const;          ///< throws std::invalid_argument naming the setting
};

/// Opens the controller and takes the drive, with what moves stopped. Throws DeviceError{not_found}
/// when it is no MPC-200 or the drive is not connected. Sixteen speeds from 0.34 to 2.77 mm/s: a
/// motion goes at the next one below what is asked, and DeviceError{refused} when there is none. A
/// motion shorter than 1 um on every axis is not made; the resolution says so. During a motion
/// nothing is sent: position() is an estimate then. home() calibrates: all axes go to the beginning
/// of their travel. One program, one drive: another program on the same port is refused by the
/// port.
std::unique_ptr<Stage> open(std::unique_ptr<ByteLink> link, const Settings& settings, Clock& clock);

}  // namespace vitreo::sutter_mpc200
