// Job process: a job as a child process that outlives this one, found again by the next server.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace vitreo::serve {

/// What a job's process left: its last line of JSON on the standard output, whichever server reads
/// it.
struct JobEnd {
  std::string outcome;  // "completed", ...; "refused", "lost"
  std::string reason;
  std::string run;    // the folder's name; empty where there is none
  bool hold = false;  // the rig is not as it should be: what waits must not start on it
};

/// The folder of one job, with the files `out`, `err` and `alive`. The process, and all that it
/// starts, hold a lock (flock) on `alive`: it is gone when nothing of it is left, whatever killed
/// it, and no number of a process that was given again is taken for it.
class JobProcess {
 public:
  explicit JobProcess(std::filesystem::path folder) : folder_(std::move(folder)) {}

  /// In a session of its own, so that neither a signal to the server nor its end reaches it.
  /// Returns its number. Throws std::runtime_error.
  int start(const std::vector<std::string>& words) const;
  bool alive() const;
  /// Lets go of a child that has ended; without effect on a process that another server started.
  static void reap(int process);
  /// Of a process that is not alive any more.
  JobEnd end(bool sweep) const;
  /// "http://127.0.0.1:38911/" as the process printed it; empty: it has none yet.
  std::string live_view() const;
  /// The last lines of the standard error, at most so many bytes.
  std::string said(std::size_t most = 4000) const;

 private:
  std::filesystem::path folder_;
};

}  // namespace vitreo::serve
