// Run control: requests to end, pause or resume a run, and its true state. Requests come from
// signal handlers, from other threads and from the script itself; the script's thread answers them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/session/remaining_time.h"
#include "host/session/stop_between.h"

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <pthread.h>
#include <semaphore.h>
#include <string>
#include <vector>

namespace vitreo {

class RunControl {
 public:
  /// Belongs to the thread that makes it: the one that runs the script.
  RunControl();
  ~RunControl();
  RunControl(const RunControl&) = delete;
  RunControl& operator=(const RunControl&) = delete;

  /// Hooks into the running script and its rig.
  struct ScriptHooks {
    /// Stops the script and its present wait. On the script's thread or in a signal handler on it:
    /// async-signal-safe.
    std::function<void()> interrupt;
    /// Brings every device to its safe state; returns what failed. Once a request, on the script's
    /// thread or, with the clock's baton, on the watchdog's.
    std::function<std::vector<std::string>()> make_safe;
  };
  void attach(ScriptHooks hooks);
  void detach();

  /// Any thread, signal handlers too. A lower tier than before changes nothing; the same one breaks
  /// off the next wait as well, which is how a clean-up that does not end is cut short.
  void request(StopTier tier) noexcept;
  /// With why, and by whom; what asks for no more than was asked for already changes neither.
  void request(StopTier tier, const std::string& reason, const EndCause& cause = {"program"});
  /// By a signal from the process `sender` (0: from the terminal). In its handler:
  /// async-signal-safe.
  void request_by_signal(int number, pid_t sender, StopTier tier) noexcept;
  /// The same for a task that holds the clock's baton: returns when the script's thread has been
  /// reached, so that a run on the virtual clock that is stopped at some moment repeats.
  void request_and_wait(StopTier tier) noexcept;
  StopTier tier() const noexcept { return tier_.load(); }
  /// The next higher tier: what one more Ctrl-C means.
  static StopTier next(StopTier tier) noexcept;

  /// Takes effect at the next checkpoint, or at the one of that name. Any thread.
  void request_pause(const std::string& checkpoint = "");
  void resume();
  bool pause_wanted_at(const std::string& checkpoint) const;
  bool resumed() const;  // no pause is wanted any more

  /// The run may go on although the condition of its suspension still holds. Any thread; the caller
  /// has checked the right to it.
  void override_suspension(const std::string& by);
  std::string take_override();  // by whom, once; empty: there is none

  /// By whom the end was requested, and why: for the end record. Empty: by the operator.
  void set_reason(const std::string& reason);
  std::string reason() const;
  /// The same in the words of the end record; {"person"} where nothing else is known.
  EndCause cause() const;
  /// "file:line" where the script was when it ended; empty until then, and where it came to its
  /// end.
  void set_location(const std::string& location);
  std::string location() const;

  /// The script's thread says where it is.
  void set_phase(RunPhase phase, const std::string& note = "");
  void set_waiting_for(const std::string& what);
  void set_progress(double fraction, const std::string& doing);
  RunStatus status() const;
  /// Changes each time the status does, for observers that poll.
  unsigned long changes() const noexcept { return changes_.load(); }

  /// The script has felt the request and unwinds. From the abort tier on the devices are made safe
  /// before anything else.
  void begin_stopping();
  /// Whether it has: then the run is not completed, whatever came of the stop on its way.
  bool stop_felt() const noexcept { return felt_.load(); }
  /// The devices' safe state, once after each attach(); what failed is kept for the record.
  void make_safe();
  bool safe() const noexcept { return safe_.load(); }
  bool making_safe() const noexcept { return making_safe_ > 0; }  // by another thread, not done
  std::vector<std::string> failures() const;

  /// For the prompt: between two statements a request is of what they have left running. Idle, the
  /// end that was asked of the last one is over; busy, so is why, and a request without an answer
  /// is of this one, as a pause is.
  void set_idle(bool idle);
  const StopBetween& between() const { return between_; }
  /// Answers what is asked there with the devices' safe state; threads as of make_safe().
  void make_safe_between();
  std::optional<AnsweredStop> take_answered();  // once

  /// For the watchdog: waits up to `patience` for a request.
  void wait_for_request(std::chrono::milliseconds patience);
  void wake_watchdog() noexcept { sem_post(&request_); }
  /// Since the first request of at least that tier of this statement; nothing when there was none.
  std::optional<std::chrono::steady_clock::duration> since(StopTier tier) const;

 private:
  std::string pause_note() const;  // under mutex_
  void forget_end() noexcept;
  friend void deliver_to_script() noexcept;
  friend RunControl* attached_control() noexcept;
  ScriptHooks hooks_;
  const pthread_t script_;
  std::atomic<StopTier> tier_{StopTier::none};
  /// ns of the steady clock, by tier; 0: never.
  std::array<std::atomic<std::int64_t>, 4> requested_at_{};
  std::atomic<bool> safe_{false}, felt_{false};
  std::atomic<int> making_safe_{0};
  std::atomic<bool> pause_{false}, idle_{false};
  std::atomic<unsigned long> changes_{0}, deliveries_{0};
  // The first signal that asked for an end, and what its sender is called: a name of Linux' has 15
  // characters. Written before `signal_`, and not again until it is 0.
  std::atomic<int> signal_{0};
  std::atomic<bool> signal_is_stronger_{false};  // than the request whose reason is known
  std::array<char, 16> sender_{};
  StopBetween between_;
  std::optional<AnsweredStop> answered_;  // under mutex_
  sem_t request_;
  mutable std::mutex mutex_;  // of what follows; never taken in a signal handler
  RunStatus status_;
  std::string pause_at_;
  std::string reason_;
  EndCause cause_;
  std::string location_, override_by_;
  RemainingTime remaining_;
  std::vector<std::string> failures_;
};

/// For signal handlers, on the script's thread: the control of the run that is going on, or null;
/// and the delivery of a request to its script, whatever thread it came from.
RunControl* attached_control() noexcept;
void deliver_to_script() noexcept;

}  // namespace vitreo
