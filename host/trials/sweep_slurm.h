// Sweep on Slurm: the points of a plan as the tasks of an array job, each of which takes points
// until none is left.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/trials/point_runner.h"

#include <functional>
#include <string>
#include <vector>

namespace vitreo {

struct SlurmRequest {
  std::string program;               // that each task starts
  int tasks = 16;                    // at most; of the array
  std::vector<std::string> options;  // of sbatch, as they are: "--partition=long"
};

/// Submits the array; the job's number. Script and logs are in slurm/ of the sweep. Throws
/// SweepError where there is no Slurm, or it refuses.
std::string submit_slurm(const PointFolder& folder, const SlurmRequest& request);

/// Until every point is marked or the job is gone. `progress` is told how many are marked. Signals
/// to stop end the waiting, not the job.
RunnerEnd wait_for_slurm(const PointFolder& folder, const std::string& job,
                         const std::function<void(std::size_t done)>& progress,
                         const std::function<void(const std::string&)>& note);

/// Where a task of an array begins among the points: its share of the way. 0 outside of Slurm.
std::size_t slurm_offset(std::size_t points);

}  // namespace vitreo
