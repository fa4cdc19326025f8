// Clock: the time, and the only way to block. Every task of a run (script, servo loop, cameras,
// emulators) waits through a Clock, so a simulated run can jump from event to event and still be
// plain blocking code.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <exception>
#include <functional>
#include <memory>
#include <string>

namespace vitreo {

/// Time since the clock was born. Integer nanoseconds, so that two runs agree to the bit.
using Time = std::chrono::nanoseconds;
constexpr Time kForever = Time::max();

inline double to_seconds(Time time) { return static_cast<double>(time.count()) * 1e-9; }
/// Throws std::invalid_argument when `seconds` is not a number or does not fit.
Time from_seconds(double seconds);
/// `start` + `duration`, both not negative; kForever where the sum would not fit.
inline Time later(Time start, Time duration) {
  return duration > kForever - start ? kForever : start + duration;
}

/// Thrown out of a wait when the waiting task has been asked to stop. Let it pass: it unwinds the
/// task.
class Stopped : public std::exception {
 public:
  const char* what() const noexcept override { return "stopped"; }
};

/// What tasks wait for; it carries no state of its own. Belongs to the owner of the condition and
/// outlives every waiter.
struct Signal {};

/// A task under a clock. The destructor requests a stop and joins.
class Task {
 public:
  virtual ~Task() = default;
  /// Its current or next wait throws Stopped; every later one too.
  virtual void request_stop() = 0;
  /// Waits for the body's end; rethrows what the body threw, except Stopped. Call it at most once.
  virtual void join() = 0;
  virtual bool done() const = 0;
};

class Clock {
 public:
  virtual ~Clock() = default;
  virtual Time now() const = 0;
  /// Returns at `due`, at once when it has passed (under the virtual clock, a task that is due now
  /// and comes before this one by its name still gets its turn). Throws Stopped.
  virtual void sleep_until(Time due) = 0;
  /// Waits until `ready()` holds or the time is `deadline`; returns `ready()`. `ready` is evaluated
  /// at the start and after each notify(signal). Throws Stopped.
  virtual bool wait(Signal& signal, const std::function<bool()>& ready, Time deadline) = 0;
  virtual void notify(Signal& signal) = 0;
  /// Runs `work`, which blocks in a library or in the kernel, and must itself end within a finite
  /// time. Under the wall clock the other tasks go on meanwhile, so `work` touches nothing of
  /// theirs. Not a wait: it does not throw Stopped.
  virtual void outside(const std::function<void()>& work) { work(); }
  /// Within the `work` of outside(): the task takes its turn back for `some`, which may wait like
  /// any code of a task; afterwards it is outside again. Throws Stopped where `some` waits.
  virtual void inside(const std::function<void()>& some) { some(); }
  /// Starts a task; among tasks due at the same time the alphabetical order of the names decides.
  virtual std::unique_ptr<Task> spawn(std::string name, std::function<void()> body) = 0;
  /// The constructing thread's task: its current or next wait throws Stopped, once.
  /// Async-signal-safe.
  virtual void interrupt() noexcept = 0;

  /// For clean-up: while deaf, the calling task's waits do not throw Stopped; the request is kept
  /// for later. Returns what was set before. Use StopShield.
  virtual bool set_deaf(bool deaf) = 0;

  /// For a watchdog's own thread, which belongs to no task: waits for the baton for `patience` of
  /// wall time, then takes it from the task that did not give it back, which blocks at its next
  /// call. Returns whether it had to take it. From then on until leave() the thread is a task like
  /// any other. One thread at a time.
  virtual bool break_in(Time patience) = 0;
  /// Whether the task that break_in() took the turn from has not come back yet.
  virtual bool displaced() = 0;
  virtual void leave() = 0;
  /// Wall time since the baton last changed hands, or since the clock last polled while all waited:
  /// at the pace of the wall clock, how long the program has been stuck. Zero at any other pace.
  /// Any thread.
  virtual Time stuck_for() const noexcept = 0;

  void sleep_for(Time duration) { sleep_until(now() + duration); }
};

/// Scope guard that defers stops: a task finishes what must not be broken off half-way, such as the
/// zeros on their way to the coils.
class StopShield {
 public:
  explicit StopShield(Clock& clock) : clock_(clock), before_(clock.set_deaf(true)) {}
  ~StopShield() { clock_.set_deaf(before_); }
  StopShield(const StopShield&) = delete;
  StopShield& operator=(const StopShield&) = delete;

 private:
  Clock& clock_;
  bool before_;
};

enum class Pace { as_fast_as_possible, real_time };

/// The clock of simulated runs: one baton (a global scheduler lock), held by one task at a time, so
/// no two tasks ever run together; when all wait, the time jumps to the next event
/// (Pace::real_time: sleeps until then). Construct it on the thread that is to be the main task and
/// destroy it there, after every Task. Throws std::logic_error out of a wait when no task could
/// ever go on.
std::unique_ptr<Clock> virtual_clock(Pace pace = Pace::as_fast_as_possible);

/// The clock of real instruments: the time is the machine's monotonic clock, counted from the
/// construction. One baton here too, so what is right under the virtual clock is right here; a task
/// that waits, or is outside(), puts it down. Construct and destroy it on the main task's thread.
/// now() and nothing else may be called by any thread.
std::unique_ptr<Clock> wall_clock();

/// s of the machine's steady clock: for what takes real time, never for the science.
double wall_seconds();

}  // namespace vitreo
