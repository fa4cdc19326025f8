// Task pool: a few threads that do what the web server's thread must not wait for, and a bounded
// line before them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace vitreo::serve {

class TaskPool {
 public:
  TaskPool(std::size_t threads, std::size_t most_waiting);
  /// Ends what is under way, and drops what waits.
  ~TaskPool();
  TaskPool(const TaskPool&) = delete;
  TaskPool& operator=(const TaskPool&) = delete;
  /// False where too many wait. A task does not throw.
  bool add(std::function<void()> task);

 private:
  void work();

  const std::size_t most_waiting_;
  std::mutex mutex_;
  std::condition_variable wake_;
  std::deque<std::function<void()>> tasks_;
  bool ended_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace vitreo::serve
