// Execution of a plan's points: on the cores of this machine, or as an array job of Slurm.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/trials/point_runner.h"
#include "host/trials/sweep_slurm.h"

#include <cstddef>
#include <functional>
#include <optional>
#include <string>

namespace vitreo {

struct ExecuteOptions {
  int jobs = 1;                         // processes at a time, without Slurm
  std::optional<SlurmRequest> slurm{};  // an array job instead
  bool detach = false;                  // of Slurm: does not wait for it
  /// A point that is finished, once each, those on Slurm too; not those that were before.
  std::function<void(std::size_t point, const nlohmann::json& result)> finished{};
  std::function<void(std::size_t point, const std::string& line)> said{};  // not on Slurm
  std::function<void(const std::string&)> note{};
};

/// Does the points that are not finished. On Slurm the tasks find the body by the kind of the plan
/// (host/trials/point_bodies.h).
RunnerEnd execute_points(const PointFolder& folder, const PointBody& body,
                         const ExecuteOptions& options);

}  // namespace vitreo
