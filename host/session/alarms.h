// Alarms: conditions that need the operator's attention, of three priorities by the need of action
// (IEC 60601-1-8), latched until the cause is gone and the alarm is acknowledged.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"
#include "host/record/run_data.h"

#include <atomic>
#include <chrono>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

namespace vitreo {

struct Alarm {
  std::string name;  // what raises it again raises the same one: "interlock", "disk"
  AlarmPriority priority = AlarmPriority::low;
  std::string text;             // of the last time
  Time raised{};                // the first time, on the run's clock
  bool active = true;           // the cause is still there: clear() was not called
  int times = 1;                // it was raised
  std::string acknowledged_by;  // empty: not, or too long ago while the cause is still there
};

/// "high: interlock: coil 3: 14 A is beyond the limit of 12 A".
std::string to_string(const Alarm& alarm);

/// Any thread. What is to be recorded waits in a queue until the thread that owns the record drains
/// it.
class Alarms {
 public:
  using Now = std::function<std::chrono::steady_clock::time_point()>;
  /// `wall`, for tests: the clock of the silence.
  explicit Alarms(
      const Clock& clock, Now wall = [] { return std::chrono::steady_clock::now(); });

  /// Anew, or again: then what was acknowledged is not any more when the priority has grown.
  void raise(const std::string& name, AlarmPriority priority, const std::string& text);
  /// The cause is gone; it stays until it is acknowledged. Of an unknown name: nothing.
  void clear(const std::string& name);
  /// Silences it for 2 minutes; when the cause is gone it goes. An empty name: all. Returns how
  /// many; throws std::invalid_argument where there is none of that name, with the names there are.
  int acknowledge(const std::string& name, const std::string& by);
  /// Those that are latched, the most urgent first, then the oldest.
  std::vector<Alarm> shown() const;
  bool anything_unacknowledged() const;
  /// Every alarm that the run has had, in the order of their raising, for its report.
  std::vector<Alarm> history() const;

  /// What happened since the last time, as events: "alarm", "alarm acknowledged", "alarm cleared".
  std::vector<Event> drain_events();
  /// Changes each time that something does.
  unsigned long changes() const noexcept { return changes_.load(); }

  static constexpr std::chrono::minutes kSilence{2};

 private:
  struct Held {
    Alarm alarm;
    std::chrono::steady_clock::time_point acknowledged_at{};
    bool latched = true;
  };
  Alarm as_shown(const Held& held) const;
  void note(const std::string& kind, const std::string& text);

  const Clock& clock_;
  const Now wall_;
  mutable std::mutex mutex_;
  std::vector<Held> held_;
  std::vector<Event> events_;
  std::atomic<unsigned long> changes_{0};
};

}  // namespace vitreo
