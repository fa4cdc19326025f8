// Sampled hardware: one machine of many, whose seed makes it different from the model.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/field_model.h"
#include "devices/sim/world.h"

#include <cstdint>
#include <random>

namespace vitreo::sim {

/// Random streams for separate purposes, so that a change in one leaves the others as they were.
enum class Purpose : std::uint64_t {
  field = 1,
  moment,
  world,
  fundus,
  top_noise,
  side_noise,
  dac,
  tuning,
  roll,
  background,
  top_jitter,
  side_jitter,
  probe,
  plant,
  pose_jitter,
  stage
};
std::uint64_t seed_for(std::uint64_t seed, Purpose purpose);
/// A hash of the three numbers (the finalizer of SplitMix64).
std::uint64_t mix(std::uint64_t a, std::uint64_t b, std::uint64_t c);

/// A sample about either kind of model: each coil's gain, a shift of all its sources, a turn of
/// their axes.
control::FieldModel perturbed(const control::FieldModel& model,
                              const control::FieldPerturbation& sigma, std::mt19937_64& random);

/// The thesis' operator (6.1), who trimmed the force by hand until the robot was stable at the
/// center.
struct HandTuning {
  double tolerance = 100e-6;      // m/s: the drift left is this times |N(0,1)|, in any direction
  double field = 10e-3;           // T, while tuning
  Eigen::Vector3d axis{1, 0, 0};  // along which the field points while tuning
  void check() const;             // throws std::invalid_argument naming the parameter
};

/// The force on the robot (N, world) that this leaves behind at the center: what the plant lacks
/// for the currents with which `believed` would levitate the robot there, and the drift of the
/// tolerance on top. It stands for the offset in the operator's commands, which has the same
/// effect; so no truth reaches the loop. Throws std::domain_error when `believed` cannot levitate
/// the robot.
Eigen::Vector3d force_left_by_tuning(const HandTuning& tuning, const WorldSettings& plant,
                                     const control::FieldModel& believed, std::mt19937_64& random);

}  // namespace vitreo::sim
