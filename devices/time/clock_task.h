// Task of a clock: a thread of its own, and what a scheduler notes of it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"

#include <exception>
#include <functional>
#include <string>
#include <thread>
#include <utility>

namespace vitreo {

/// What both clocks note of a task. Touched only by the task that holds the baton.
struct TaskEntry {
  std::string name;
  std::thread::id thread;
  const Signal* signal = nullptr;  ///< what it waits for, if anything
  bool deaf = false;               ///< its waits must not be broken off: it is cleaning up
  bool stop = false;
  bool done = false;
  Signal ended;
  std::exception_ptr error;  ///< what its body threw, except Stopped

  /// Runs the body to its end. What it captured dies here, with the baton in hand.
  void run(std::function<void()>& body) {
    try {
      body();
    } catch (const Stopped&) {  // an ordinary end
    } catch (...) {
      error = std::current_exception();
    }
    body = nullptr;
    done = true;
  }
};

/// `OfClock` is a Clock with start(entry, thread, body) and request_stop(entry); `Entry` is its
/// TaskEntry.
template <class OfClock, class Entry>
class ClockTask final : public Task {
 public:
  ClockTask(OfClock& clock, const std::string& name) : clock_(clock) { entry_.name = name; }
  ClockTask(const ClockTask&) = delete;
  ClockTask& operator=(const ClockTask&) = delete;
  ~ClockTask() override {
    if (!thread_.joinable()) return;
    clock_.request_stop(entry_);
    {
      const StopShield shield(clock_);
      wait_for_end();
    }
    join_thread();
  }

  void start(std::function<void()> body) { clock_.start(entry_, thread_, std::move(body)); }
  void request_stop() override { clock_.request_stop(entry_); }
  void join() override {
    wait_for_end();
    join_thread();
    if (entry_.error) std::rethrow_exception(std::exchange(entry_.error, nullptr));
  }
  bool done() const override { return entry_.done; }

 private:
  void wait_for_end() {
    clock_.wait(
        entry_.ended, [this] { return entry_.done; }, kForever);
  }
  /// The thread has given the baton back for good; other tasks may go on while the system ends it.
  void join_thread() {
    if (thread_.joinable()) clock_.outside([this] { thread_.join(); });
  }

  OfClock& clock_;
  Entry entry_;
  std::thread thread_;
};

}  // namespace vitreo
