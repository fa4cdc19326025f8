// Point runner: the points of a plan on the cores of this machine, each in a process of its own,
// claimed before and marked after.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/trials/point_folder.h"
#include "host/trials/worker_pool.h"

#include <cstddef>
#include <functional>
#include <string>

namespace vitreo {

/// What is done at a point, in a process of its own; `say` gives lines to the runner's `said`
/// while it goes on. Its result has "outcome"; where that is "stopped" because the runner was told
/// to stop, the point stays unfinished.
using PointBody =
    std::function<nlohmann::json(const PlannedPoint&, std::size_t point, const SayLine& say)>;

struct RunnerOptions {
  int jobs = 1;                 // processes at a time
  std::size_t offset = 0;       // of the first point that is tried: others begin elsewhere
  bool wait_for_others = true;  // for points at which other processes work
  std::function<void(std::size_t point, const nlohmann::json& result)> finished{};
  std::function<void(std::size_t point, const std::string& line)> said{};
  std::function<void(const std::string&)> note{};  // for people: what is waited for, what died
};

/// `handed_over`: to a scheduler that goes on with them without this program.
enum class RunnerEnd { all_done, some_left, stopped, handed_over };

/// Does every point that is not finished. Signals to stop are passed on to the points under way.
/// Throws std::runtime_error where nothing can be written, when all that was under way has ended:
/// what is marked stays.
RunnerEnd run_points(const PointFolder& folder, const PointBody& body,
                     const RunnerOptions& options);

}  // namespace vitreo
