// SPDX-License-Identifier: Apache-2.0
#include "host/trials/point_execution.h"

namespace vitreo {
namespace {

/// Of an array job: tells of each point as its mark appears.
RunnerEnd execute_on_slurm(const PointFolder& folder, const ExecuteOptions& options) {
  std::vector<std::size_t> left = folder.unfinished();
  if (left.empty()) return RunnerEnd::all_done;
  const std::string job = submit_slurm(folder, *options.slurm);
  const auto note = [&options](const std::string& text) {
    if (options.note) options.note(text);
  };
  note("Slurm job " + job + "; its logs are in " + (folder.folder() / "slurm").string());
  if (options.detach) return RunnerEnd::handed_over;
  const auto progress = [&](std::size_t) {
    std::erase_if(left, [&](std::size_t point) {
      if (!folder.is_marked(point)) return false;
      if (options.finished) options.finished(point, folder.result(point).value());
      return true;
    });
  };
  const RunnerEnd end = wait_for_slurm(folder, job, progress, note);
  if (end == RunnerEnd::stopped)
    note("the job goes on without this program; scancel " + job + " ends it");
  return end;
}

}  // namespace

RunnerEnd execute_points(const PointFolder& folder, const PointBody& body,
                         const ExecuteOptions& options) {
  if (options.slurm) return execute_on_slurm(folder, options);
  RunnerOptions runner;
  runner.jobs = options.jobs;
  runner.finished = options.finished;
  runner.said = options.said;
  runner.note = options.note;
  return run_points(folder, body, runner);
}

}  // namespace vitreo
