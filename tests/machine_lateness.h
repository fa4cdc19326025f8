// The machine's own share of a test's lateness.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"
#include "devices/time/quiet_thread.h"

#include <atomic>
#include <chrono>
#include <thread>

namespace vitreo {

/// How late this machine wakes a thread that does nothing but sleep, beside what is measured: the
/// machine's own share of every lateness.
class MachineLateness {
 public:
  MachineLateness() {
    thread_ = quiet_thread([this] {
      while (!over_) {
        const auto due = std::chrono::steady_clock::now() + std::chrono::milliseconds(2);
        std::this_thread::sleep_until(due);
        const Time late = std::chrono::steady_clock::now() - due;
        if (late > worst_.load()) worst_ = late;
      }
    });
  }
  ~MachineLateness() {
    over_ = true;
    thread_.join();
  }
  MachineLateness(const MachineLateness&) = delete;
  MachineLateness& operator=(const MachineLateness&) = delete;
  Time worst() const { return worst_; }

 private:
  std::atomic<bool> over_{false};
  std::atomic<Time> worst_{Time(0)};
  std::thread thread_;
};

}  // namespace vitreo
