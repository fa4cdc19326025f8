// Driver of the Pololu Tic (T825 and its kin): a stepper motor that moves the BIOM's condensing
// lens. Every motion is a call in progress that polls the motor and feeds its command timeout,
// which stops it when the host hangs or the cable is pulled (docs/instruments.md).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/usb_link.h"
#include "devices/roles/lens_mover.h"
#include "devices/time/clock.h"

#include <memory>
#include <string>

namespace vitreo::pololu_tic {

/// Side of the home switch. Without one, home() assumes that the lens was put at home_position by
/// hand.
enum class Home { none, reverse, forward };

struct Settings {
  std::string name = "lens_mover";  ///< in errors
  /// m of lens travel per full step; negative where forward is towards the eye.
  double step_length = 5e-6;
  int usteps_per_step = 8;      ///< 1, 2, 4, 8, 16 or 32
  double speed = 5e-3;          ///< m/s
  double acceleration = 50e-3;  ///< m/s^2, and deceleration
  double travel_min = -10e-3;   ///< m
  double travel_max = 10e-3;    ///< m
  double current_limit = 0.48;  ///< A, of the motor's coils; rounded down to the controller's steps
  Home home = Home::reverse;
  double home_position = -10e-3;  ///< m: where the lens is when the home switch is just released
  double command_timeout = 1.0;   ///< s: how long the motor goes on when the host falls silent
  double transfer_timeout = 0.1;  ///< s, of one exchange
  void check() const;             ///< throws std::invalid_argument naming the setting
};

/// Opens and configures the controller: identity, settings applied and read back. Does not move and
/// does not energize what was not; where the controller does not know its position, moves are
/// refused until home(). Throws DeviceError. Destruction stops the motor.
std::unique_ptr<LensMover> open(std::unique_ptr<UsbLink> link, const Settings& settings,
                                Clock& clock);

}  // namespace vitreo::pololu_tic
