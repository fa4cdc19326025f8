// Soak checks: what must hold of every run of a soak test, whatever happened to it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/sim/laboratory.h"
#include "host/engine/run_engine.h"
#include "host/trials/soak_plan.h"

#include <filesystem>
#include <string>
#include <vector>

namespace vitreo {

/// A run that was left alone: what the others are compared with.
struct SoakReference {
  double horizon = 0;  // s
  SimulatedRoles roles;
  std::vector<Stream> streams;
};

/// Observations of the disturbing task.
struct SoakWitness {
  bool asked = false;  // the stop came while the script ran
  std::vector<std::string> violations;
};

/// Of a run that has ended and was recorded, while its rig is still open.
std::vector<std::string> check_ended(const SoakPlan& plan, const SoakWitness& witness,
                                     const SoakReference& reference, const Recorder& recorder,
                                     OpenRig& rig);
/// Whether the result says what the record and the plan say.
std::vector<std::string> check_result(const SoakPlan& plan, const SoakWitness& witness,
                                      const RunResult& result);
/// Of a run whose process was killed a second of wall time after `samples` had been recorded.
std::vector<std::string> check_killed(const std::filesystem::path& parent, std::uint64_t samples);

/// Largest magnitude of the amplifier's outputs, V, as they really are.
double outputs_of(sim::Laboratory& laboratory);
constexpr double kZeroOutput = 5e-3;  // V: a count of the USB-3103 is 0.3 mV
/// Whether the plan may keep the host from zeroing: a wire to the coils that does not carry.
bool coils_unreachable(const SoakPlan& plan);

/// Of this process: what must not grow from run to run.
struct Footprint {
  std::size_t descriptors = 0;
  std::size_t threads = 0;
  std::size_t heap = 0;  // bytes in use
};
Footprint footprint();

}  // namespace vitreo
