// Timetable: calls at their times, from a thread of its own that holds its owner's lock only while
// it calls; for the frames of an emulated USB, which nothing may sleep through.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/testbed/fair_mutex.h"
#include "devices/time/clock.h"
#include "devices/time/quiet_thread.h"

#include <condition_variable>
#include <functional>
#include <map>
#include <mutex>
#include <sys/prctl.h>
#include <thread>
#include <utility>

namespace vitreo {

class Timetable {
 public:
  /// `mutex` outlives it.
  explicit Timetable(FairMutex& mutex) : mutex_(mutex) {
    thread_ = quiet_thread([this] { run(); });
  }
  ~Timetable() {
    {
      const std::lock_guard lock(mutex_);
      ended_ = true;
    }
    changed_.notify_all();
    thread_.join();
  }
  Timetable(const Timetable&) = delete;
  Timetable& operator=(const Timetable&) = delete;

  FairMutex& mutex() const { return mutex_; }
  /// The machine's steady time.
  Time now() const {
    return std::chrono::duration_cast<Time>(std::chrono::steady_clock::now().time_since_epoch());
  }
  /// Under the lock, as forget(). Calls of one time are made in the order in which they were added.
  void add(Time due, const void* owner, std::function<void()> work) {
    calls_.insert({due, {owner, std::move(work)}});
    changed_.notify_all();
  }
  /// None of the owner's calls is made any more.
  void forget(const void* owner) {
    std::erase_if(calls_, [owner](const auto& one) { return one.second.owner == owner; });
  }

 private:
  struct Call {
    const void* owner;
    std::function<void()> work;
  };
  void run() {
    prctl(PR_SET_TIMERSLACK, 1);  // ns: the usual 50 us would be a twentieth of each frame
    std::unique_lock lock(mutex_);
    while (!ended_) {
      if (calls_.empty()) {
        changed_.wait(lock);
      } else if (const Time due = calls_.begin()->first; now() < due) {
        changed_.wait_until(lock, std::chrono::steady_clock::time_point(due));
      } else {
        const auto first = calls_.extract(calls_.begin());
        first.mapped().work();
      }
    }
  }

  FairMutex& mutex_;
  std::condition_variable_any changed_;
  std::multimap<Time, Call> calls_;
  bool ended_ = false;
  std::thread thread_;
};

}  // namespace vitreo
