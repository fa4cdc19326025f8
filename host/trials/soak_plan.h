// Soak plan: faults, stop or kill of one run, drawn from a seed; and the report of one seed.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/session/faults.h"
#include "host/session/run_control.h"

#include <nlohmann/json.hpp>

#include <cstdint>
#include <string>
#include <vector>

namespace vitreo {

/// The disturbances of one run.
struct SoakPlan {
  std::vector<Fault> faults;
  StopTier tier = StopTier::none;  // asked for at `at`
  bool kill = false;               // the process, at `at`
  double at = 0;                   // s of the run's clock
  std::uint64_t machine = 0;       // the machine and the eye that are drawn; 0: the reference's
  std::string script{};            // how the script misbehaves (soak_script.h); empty: it does not
};
std::string to_string(const SoakPlan& plan);
/// A function of its arguments alone. `horizon`: s, how long the run takes when it is left alone.
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

}  // namespace vitreo
