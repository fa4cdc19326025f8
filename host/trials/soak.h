// Soak test: a protocol on the simulated rig again and again, each time under faults, stops and
// kills at moments that a seed draws, and each time the same questions: are the outputs safe, is
// the record whole and true, did it end at all?
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/engine/run_engine.h"
#include "host/trials/soak_plan.h"
#include "host/trials/sweep_slurm.h"

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace vitreo {

struct SoakRequest {
  // Protocol, rig, arguments, seed; in `out` the records of seeds with violations stay.
  RunRequest run;
  std::uint64_t first = 1;
  std::uint64_t count = 100;
  std::chrono::seconds patience{120};              // wall time for one seed; then it is stuck
  int jobs = 1;                                    // processes at a time, without Slurm
  std::optional<SlurmRequest> slurm{};             // an array job instead, its `tasks` at a time
  std::function<void(const std::string&)> note{};  // what there is to say of the job
};

struct SoakResult {
  std::uint64_t seeds = 0;
  std::uint64_t violations = 0;
  std::vector<std::uint64_t> bad_seeds;
  std::map<std::string, int> outcomes;
  double seconds = 0;  // wall time
};
nlohmann::json to_json(const SoakResult& result);

/// Runs them in child processes, so that this one sees those die, or stand still: the seeds in
/// groups, which are the points of a plan (host/trials/point_folder.h). `report` is called for
/// each, in their order; on Slurm once a group has ended. Throws as run_protocol() does for what is
/// wrong with the request; ConfigError for a rig with real instruments, and where the protocol does
/// not complete when it is left alone.
SoakResult soak(ScriptEngine& engine, const SoakRequest& request,
                const std::function<void(const SoakedSeed&)>& report);

/// The seeds of one group, one after the other in a process beside this one, so that what leaks
/// from run to run shows; says a line of JSON for each.
constexpr const char* kSoakKind = "soak";
nlohmann::json run_soak_point(ScriptEngine& engine, const nlohmann::json& head,
                              const nlohmann::json& what,
                              const std::function<void(const std::string&)>& say);

}  // namespace vitreo
