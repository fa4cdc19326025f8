// Sees that a run that was told to end does end: devices safe within 250 ms of an abort even when
// the script is stuck in a call that nothing can interrupt, and the process gone when it stays
// stuck. And that the coils of a program that does not move go to zero.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"
#include "host/session/run_control.h"

#include <atomic>
#include <chrono>
#include <functional>
#include <string>
#include <thread>

namespace vitreo {

/// Wall time, all of it.
struct WatchdogLimits {
  std::chrono::milliseconds clean_up{6000};  // after a stop; then it is an abort
  std::chrono::milliseconds safe{250};  // after an abort, until the devices are made safe by force
  std::chrono::milliseconds grace{5000};  // after an abort, until the run is given up
  std::chrono::milliseconds dead_man{
      250};  // of a program at the pace of the wall clock that does not move
  std::chrono::milliseconds told{
      1000};  // after a stop, until what it waits for is told; and between two tellings
};

/// What the watchdog does, with the clock's baton in hand.
struct WatchdogActions {
  /// Writes the end record of a run that does not respond, and leaves the process.
  std::function<void()> give_up;
  /// Whether anything is energized; called from the watchdog's thread at any time.
  std::function<bool()> energized;
  /// The coils to zero, and why.
  std::function<void(const std::string&)> trip;
  /// Tells people how far a stop has come that takes its time; without the baton. May be null.
  std::function<void(const std::string&)> tell{};
};

/// Lives as long as the script runs. A thread of its own, which takes the clock's baton by force
/// when it must.
class Watchdog {
 public:
  Watchdog(RunControl& control, Clock& clock, const WatchdogLimits& limits,
           WatchdogActions actions);
  /// Lets it finish what it is at: the devices' safe state is waited for on the clock.
  ~Watchdog();
  Watchdog(const Watchdog&) = delete;
  Watchdog& operator=(const Watchdog&) = delete;

 private:
  void watch();
  void look();
  void take_over();
  void look_at_pace();
  void tell();

  RunControl& control_;
  Clock& clock_;
  const WatchdogLimits limits_;
  const WatchdogActions actions_;
  std::atomic<bool> done_{false};
  std::atomic<bool> inside_{false};  // it is a task of the clock now
  std::string told_;
  std::chrono::steady_clock::time_point told_at_{};
  std::thread thread_;
};

}  // namespace vitreo
