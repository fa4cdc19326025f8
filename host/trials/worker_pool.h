// Worker pool: tasks in processes of their own, forked from this one, each with a pipe for what it
// says, line by line.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <map>
#include <string>
#include <sys/types.h>
#include <vector>

namespace vitreo {

/// SIGINT, SIGTERM and SIGHUP are counted instead of obeyed while it lives; one of it at a time.
class StopCount {
 public:
  StopCount();
  ~StopCount();
  StopCount(const StopCount&) = delete;
  StopCount& operator=(const StopCount&) = delete;
  static int count() noexcept;
};

/// What a task gives its lines to; the text has no line end.
using SayLine = std::function<void(const std::string&)>;

class WorkerPool {
 public:
  struct Event {
    std::size_t task = 0;
    bool ended = false;
    std::string line;  // where it has not ended
    int status = 0;    // of an end: as waitpid() has it
  };
  WorkerPool() = default;
  /// Kills what still runs.
  ~WorkerPool();
  WorkerPool(const WorkerPool&) = delete;
  WorkerPool& operator=(const WorkerPool&) = delete;

  /// Forks: this process must have one thread. `body` runs in the child, which then ends; it is
  /// told to stop (SIGTERM) when this process dies. Throws std::runtime_error.
  void start(std::size_t task, const std::function<void(const SayLine&)>& body);
  /// What has happened meanwhile, waiting at most so long for the first thing.
  std::vector<Event> wait(std::chrono::milliseconds patience);
  std::size_t running() const { return workers_.size(); }
  void signal(int number) const;

 private:
  struct Worker {
    pid_t process = -1;
    int pipe = -1;
    std::string received;  // the beginning of a line
  };
  void take_lines(std::size_t task, Worker& worker, std::vector<Event>& events);

  std::map<std::size_t, Worker> workers_;
};

/// "ended by signal 9", "left with 3".
std::string status_text(int status);

}  // namespace vitreo
