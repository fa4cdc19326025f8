// Emulator of the MPC-200: its end of the wire, for the simulated laboratory and the tests.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/sutter_mpc200/wire.h"
#include "devices/links/byte_link.h"

#include <chrono>
#include <memory>

namespace vitreo::sutter_mpc200 {

struct EmulatorSettings {
  Usteps start{};  ///< where the drives stand
  Connected connected{true, false, false, false};
  int version = 110;  ///< times 100
  /// Less between the first byte of a straight motion and the next crashes it; 0 where the pause
  /// cannot be measured, as on a real wire that is polled.
  Time straight_pause = std::chrono::milliseconds(kStraightPause_ms);
};

/// Any byte but the interrupt is lost during a motion. A straight motion that comes in one write
/// crashes it.
class Emulator : public BytePeer {
 public:
  virtual Usteps position(int drive, Time now) const = 0;  ///< from 1
  virtual bool moving(Time now) const = 0;
  virtual bool crashed() const = 0;
  virtual void fall_silent() = 0;  ///< it moves on, and sends nothing more
  /// Its motions end after this part of their way, as if all were well.
  virtual void stop_short(double part) = 0;
};

std::unique_ptr<Emulator> make_emulator(const EmulatorSettings& settings = {});

}  // namespace vitreo::sutter_mpc200
