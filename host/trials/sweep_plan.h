// Sweep plan: the points of a protocol over its parameters and seeds, with their keys.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/engine/request.h"
#include "host/trials/point_folder.h"
#include "host/trials/sweep_axes.h"

#include <cstdint>
#include <string>
#include <vector>

namespace vitreo {

/// Seeds of the points. fresh: each its own; paired: the same ones for every setting, so that
/// settings are compared on the same machines; same: one for all, so that repeats differ by nothing
/// but what no seed governs.
enum class SweepSeeds { fresh, paired, same };

struct SweepRequest {
  RunRequest run;  // its arguments are the axes' words; its seed is the first one
  SweepDraws draws;
  int repeats = 1;
  SweepSeeds seeds = SweepSeeds::fresh;
  std::uint64_t most = 10'000;  // points
};

/// The seed of a repeat (from 0) at a setting. Fresh ones are in the order of the repeats: with
/// more repeats the earlier points stay what they were.
std::uint64_t seed_of(const SweepRequest& request, std::size_t settings, std::size_t setting,
                      std::size_t repeat);

/// All points: setting by setting, its repeats together. Checks every argument, and the first
/// setting against the rig. Throws ScriptError, ConfigError; ConfigError for more than
/// `request.most` points.
PointPlan plan_sweep(ScriptEngine& engine, const SweepRequest& request);

/// The protocol and the rig are still those of the plan. Throws SweepError.
void check_unchanged(ScriptEngine& engine, const nlohmann::json& head);

/// The run at a point of such a plan, in this process: its result as the mark has it, {"outcome",
/// "exit_code", "reason", "run", "results": [{"name", "value", "unit"}], "wall_time"}. What is
/// wrong with the request is "refused". `out` is the folder for the run's own.
nlohmann::json run_sweep_point(ScriptEngine& engine, const nlohmann::json& head,
                               const nlohmann::json& what, const std::filesystem::path& out);

/// The result of a request as above; also for plans of another kind.
nlohmann::json run_request_point(ScriptEngine& engine, const RunRequest& request);

}  // namespace vitreo
