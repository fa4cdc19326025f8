// SPDX-License-Identifier: Apache-2.0
#include "host/serve/task_pool.h"

#include "devices/time/quiet_thread.h"

#include <utility>

namespace vitreo::serve {

TaskPool::TaskPool(std::size_t threads, std::size_t most_waiting) : most_waiting_(most_waiting) {
  for (std::size_t i = 0; i < threads; ++i) threads_.push_back(quiet_thread([this] { work(); }));
}

// Tasks that wait are dropped: their visitors are let go with the server.
TaskPool::~TaskPool() {
  {
    const std::lock_guard lock(mutex_);
    ended_ = true;
    tasks_.clear();
  }
  wake_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

// Bounded: a flood is refused at once instead of being answered late.
bool TaskPool::add(std::function<void()> task) {
  {
    const std::lock_guard lock(mutex_);
    if (ended_ || tasks_.size() >= most_waiting_) return false;
    tasks_.push_back(std::move(task));
  }
  wake_.notify_one();
  return true;
}

void TaskPool::work() {
  for (;;) {
    std::function<void()> task;
    {
      std::unique_lock lock(mutex_);
      wake_.wait(lock, [this] { return ended_ || !tasks_.empty(); });
      if (ended_) return;
      task = std::move(tasks_.front());
      tasks_.pop_front();
    }
    // Without the lock: other threads take the next ones meanwhile.
    task();
  }
}

}  // namespace vitreo::serve
