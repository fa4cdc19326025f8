// World behind emulated instruments: one clock, one simulated laboratory and one USB testbed for
// threads that take turns.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/sim/laboratory.h"
#include "devices/testbed/fair_mutex.h"
#include "devices/testbed/usb_testbed.h"
#include "devices/time/clock.h"

#include <cstdint>
#include <functional>
#include <memory>

namespace vitreo {

/// Threads: the cameras', the wires', the truth's and the faults'; and the testbed's own, which
/// calls the emulators that are plugged in. The laboratory and the emulators know nothing of them.
class EmulatedWorld {
 public:
  /// Throws as sim::Laboratory does.
  EmulatedWorld(const sim::LaboratorySettings& settings, std::uint64_t seed)
      : laboratory_(settings, *clock_, seed) {}

  Clock& clock() { return *clock_; }
  sim::Laboratory& laboratory() { return laboratory_; }
  /// Made when something is plugged in: a rig without USB needs no umockdev.
  UsbTestbed& testbed();

  /// `work` on the laboratory and the emulators; nothing else touches them meanwhile.
  void with(const std::function<void()>& work);
  /// `work` on the testbed itself, which plugs and unplugs. The testbed's thread goes on meanwhile,
  /// so no emulator may be touched.
  void in_turn(const std::function<void()>& work);

 private:
  // In this order: the testbed ends before the laboratory whose emulators it borrows.
  std::unique_ptr<Clock> clock_ = wall_clock();
  sim::Laboratory laboratory_;
  FairMutex turns_;
  std::unique_ptr<UsbTestbed> testbed_;
};

}  // namespace vitreo
