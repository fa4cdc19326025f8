// Dispatcher: takes the jobs of the queue one after the other, watches the process of each, and
// writes down how it ended.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/serve/job_process.h"
#include "host/serve/job_queue.h"
#include "host/serve/messages.h"
#include "host/serve/run_link.h"

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <mutex>
#include <set>
#include <string>
#include <thread>

namespace vitreo::serve {

struct DispatcherSettings {
  std::string program;             // the path of this program
  std::filesystem::path state;     // jobs/ID is made in it
  std::filesystem::path runs;      // where runs make their folders
  std::filesystem::path sweeps;    // and sweeps theirs
  std::filesystem::path messages;  // the settings file
  std::filesystem::path token_file;
  std::string address = "127.0.0.1";  // of the live views
  int live_port = 0;
};

/// Holds no instrument: each job is a process of its own, which goes on when this one is killed and
/// is found again by the next dispatcher. Borrows the queue.
class Dispatcher {
 public:
  Dispatcher(JobQueue& queue, DispatcherSettings settings);
  ~Dispatcher();
  Dispatcher(const Dispatcher&) = delete;
  Dispatcher& operator=(const Dispatcher&) = delete;

  /// A person asks for it now, and stays for the next quarter of an hour.
  static constexpr std::int64_t kAttended = 900;  // s

  /// To the run of the job that goes on. Throws ConfigError where there is none.
  nlohmann::json command(const nlohmann::json& request) const;
  /// {"job", "run", "status", "live", "progress", "points", "done"} of the job that goes on, or
  /// null.
  nlohmann::json running() const;
  /// "http://127.0.0.1:38911/"; empty while there is none.
  std::string live_view() const;
  std::string said(std::int64_t job) const;
  /// Rehearses a request on the rig's twin: {"passed", "duration", "problems", "warnings", "asks",
  /// "peak", "energized", "disk_bytes", "wall_time"}. Waits for it, at most a minute.
  nlohmann::json rehearse(const JobRequest& request) const;
  /// Counts what a page shows of all this.
  unsigned long changes() const;

 private:
  void work();
  void step();
  void rehearsals();
  void start(const Job& job);
  void watch(const Job& job);
  void watch_alarms(const Job& job);
  void watch_points(const Job& job);
  void conclude(const Job& job, JobEnd end);
  std::string place_of(const Job& job) const;
  std::filesystem::path folder_of(std::int64_t job) const;
  std::pair<std::string, std::string> message_of(const Job& job, const JobEnd& end) const;
  void raise(const Job& job, const std::string& subject, const std::string& text);

  JobQueue& queue_;
  const DispatcherSettings settings_;
  RunLink link_;
  std::set<std::string> raised_;             // alarms and questions of the run that were told
  std::int64_t asked_since_ = 0;             // s since 1970; 0: no question stands
  int looks_ = 0;                            // at the sweep that goes on
  std::atomic<std::size_t> points_done_{0};  // of it
  std::atomic<unsigned long> points_changes_{0};
  std::mutex mutex_;
  std::condition_variable wake_;
  bool ended_ = false;
  std::thread thread_, rehearser_;
};

}  // namespace vitreo::serve
