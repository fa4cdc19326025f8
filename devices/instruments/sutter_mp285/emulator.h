// Emulator of the MP-285: its end of the wire, for the simulated laboratory and the tests.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/sutter_mp285/wire.h"
#include "devices/links/byte_link.h"

#include <memory>

namespace vitreo::sutter_mp285 {

struct EmulatorSettings {
  Usteps start{};     ///< where it stands
  int version = 312;  ///< times 100
};

/// As after power-up: ignores everything before a first V. Any byte during a motion ends it.
class Emulator : public BytePeer {
 public:
  virtual Usteps position(Time now) const = 0;
  virtual bool moving(Time now) const = 0;
  /// It moves on, and sends nothing more.
  virtual void fall_silent() = 0;
  /// Its motions end after this part of their way, as if all were well.
  virtual void stop_short(double part) = 0;
};

std::unique_ptr<Emulator> make_emulator(const EmulatorSettings& settings = {});

}  // namespace vitreo::sutter_mp285
