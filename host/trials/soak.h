// Soak: a protocol on the simulated rig again and again, each time under faults, stops and kills at
// moments that a seed draws, and each time the same questions: are the outputs safe, is the record
// whole and true, did it end at all?
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/engine/run_engine.h"
#include "host/session/faults.h"
#include "host/session/run_control.h"

#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace vitreo {

struct SoakRequest {
  RunRequest run;  // protocol, rig, arguments, seed; `out` is where the records of seeds with
                   // violations stay
  std::uint64_t first = 1, count = 100;
  std::chrono::seconds patience{120};  // wall time for one seed; then it is stuck
};

/// What happens to one run.
struct SoakPlan {
  std::vector<Fault> faults;
  StopTier tier = StopTier::none;  // asked for at `at`
  bool kill = false;               // the process, at `at`
  double at = 0;                   // s of the run's clock
};
std::string to_string(const SoakPlan& plan);
/// Nothing but `seed` decides. `horizon`: s, how long the run takes when it is left alone.
SoakPlan draw_plan(std::uint64_t seed, const SimulatedRoles& roles, double horizon);

struct SoakedSeed {
  std::uint64_t seed = 0;
  std::string plan{};
  std::string ending{};  // outcome, when, why; the same each time
  std::string outcome{};
  std::string digest{};  // of all that was recorded; empty where the wall clock has a part in it
  std::vector<std::string> violations{};
};
nlohmann::json to_json(const SoakedSeed& one);
std::string to_text(const SoakedSeed& one);

struct SoakResult {
  std::uint64_t seeds = 0, violations = 0;
  std::vector<std::uint64_t> bad_seeds;
  std::map<std::string, int> outcomes;
  double seconds = 0;  // wall time
};
nlohmann::json to_json(const SoakResult& result);

/// Runs them in child processes, so that this one sees those die, or stand still. `told` is called
/// after each. Throws as run_protocol() does for what is wrong with the request; ConfigError for a
/// rig with real instruments, and where the protocol does not complete when it is left alone.
SoakResult soak(ScriptEngine& engine, const SoakRequest& request,
                const std::function<void(const SoakedSeed&)>& told);

}  // namespace vitreo
