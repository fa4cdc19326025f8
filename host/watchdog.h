// Sees that a run that was told to end does end: devices safe within 250 ms of an abort even when the script is stuck
// in a call that nothing can interrupt, and the process gone when it stays stuck.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/clock.h"
#include "host/run_control.h"

#include <atomic>
#include <chrono>
#include <functional>
#include <thread>

namespace vitreo {

/// Wall time, all of it.
struct WatchdogLimits {
  std::chrono::milliseconds clean_up{6000};  // after a stop; then it is an abort
  std::chrono::milliseconds safe{250};       // after an abort, until the devices are made safe by force
  std::chrono::milliseconds grace{5000};     // after an abort, until the run is given up
};

/// Lives as long as the script runs. A thread of its own, which takes the clock's baton by force when it must.
class Watchdog {
 public:
  /// `give_up` writes the end record of a run that does not respond, and leaves the process; it is called with the
  /// clock's baton in hand.
  Watchdog(RunControl& control, Clock& clock, const WatchdogLimits& limits, std::function<void()> give_up);
  ~Watchdog();
  Watchdog(const Watchdog&) = delete;
  Watchdog& operator=(const Watchdog&) = delete;

 private:
  void watch();
  void look();
  void take_over();

  RunControl& control_;
  Clock& clock_;
  const WatchdogLimits limits_;
  const std::function<void()> give_up_;
  std::atomic<bool> done_{false};
  std::thread thread_;
};

}  // namespace vitreo
