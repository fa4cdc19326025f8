// Watchdog: forces a stopped or aborted run to a safe end within its deadlines: devices safe within
// 250 ms of an abort even when the script is stuck in a call that nothing can interrupt, and the
// process ended when it stays stuck. Dead-man of the coils: zero when the program does not move.
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

/// All in wall time.
struct WatchdogLimits {
  /// After a stop; then it is an abort.
  std::chrono::milliseconds clean_up{6000};
  /// After an abort, until the devices are made safe by force.
  std::chrono::milliseconds safe{250};
  /// After an abort, until the run is given up.
  std::chrono::milliseconds grace{5000};
  /// Of a program at the pace of the wall clock that does not move.
  std::chrono::milliseconds dead_man{250};
  /// After a stop, until the first report of what it waits for; and between two reports.
  std::chrono::milliseconds report_interval{1000};
};

/// Actions of the watchdog, called with the clock's baton (devices/time/clock.h) unless said
/// otherwise.
struct WatchdogActions {
  /// Writes the end record of a run that does not respond, and leaves the process.
  std::function<void()> give_up;
  /// Whether anything is energized; called from the watchdog's thread at any time.
  std::function<bool()> energized;
  /// Sets the coils to zero; the argument says why.
  std::function<void(const std::string&)> trip;
  /// Reports the state of a stop that takes its time; without the baton. May be null.
  std::function<void(const std::string&)> report{};
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
  void check_ending();
  void check_between();
  void take_over();
  void check_pace();
  void report();

  RunControl& control_;
  Clock& clock_;
  const WatchdogLimits limits_;
  const WatchdogActions actions_;
  std::atomic<bool> done_{false};
  std::atomic<bool> inside_{false};  // it is a task of the clock now
  std::string reported_;
  std::chrono::steady_clock::time_point reported_at_{};
  std::thread thread_;
};

}  // namespace vitreo
