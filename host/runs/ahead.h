// Work ahead: results of a numbered series, made by threads in front of the one that takes them in
// order.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/quiet_thread.h"

#include <algorithm>
#include <condition_variable>
#include <cstddef>
#include <exception>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace vitreo {

/// The text of each number from 0 to `count` - 1. At most a few wait for the taker, so memory does
/// not grow with the series.
class Ahead {
 public:
  /// `make` is called on several threads at once.
  Ahead(std::size_t count, std::function<std::string(std::size_t)> make)
      : count_(count), make_(std::move(make)) {
    const std::size_t threads = std::clamp<std::size_t>(std::thread::hardware_concurrency(), 1, 8);
    slots_.resize(2 * threads);
    for (std::size_t i = 0; i < std::min(threads, count); ++i)
      threads_.push_back(quiet_thread([this] { work(); }));
  }
  ~Ahead() {
    {
      const std::lock_guard lock(mutex_);
      count_ = 0;
    }
    changed_.notify_all();
    for (std::thread& thread : threads_) thread.join();
  }
  Ahead(const Ahead&) = delete;
  Ahead& operator=(const Ahead&) = delete;

  /// The next one. Throws what `make` threw for it.
  std::string take() {
    std::unique_lock lock(mutex_);
    Slot& slot = slots_[taken_ % slots_.size()];
    changed_.wait(lock, [&] { return slot.there; });
    slot.there = false;
    ++taken_;
    std::string text = std::move(slot.text);
    const std::exception_ptr error = std::exchange(slot.error, nullptr);
    lock.unlock();
    changed_.notify_all();
    if (error) std::rethrow_exception(error);
    return text;
  }

 private:
  struct Slot {
    bool there = false;
    std::string text;
    std::exception_ptr error;
  };

  // The slot of a number is free once the number a whole round before it was taken.
  void work() {
    std::unique_lock lock(mutex_);
    while (true) {
      changed_.wait(lock, [&] { return begun_ >= count_ || begun_ < taken_ + slots_.size(); });
      if (begun_ >= count_) return;
      const std::size_t number = begun_++;
      lock.unlock();
      Slot made{true, {}, nullptr};
      try {
        made.text = make_(number);
      } catch (...) {  // thrown where it is taken
        made.error = std::current_exception();
      }
      lock.lock();
      slots_[number % slots_.size()] = std::move(made);
      changed_.notify_all();
    }
  }

  std::size_t count_;
  const std::function<std::string(std::size_t)> make_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<Slot> slots_;
  std::size_t begun_ = 0;
  std::size_t taken_ = 0;
  std::vector<std::thread> threads_;
};

}  // namespace vitreo
