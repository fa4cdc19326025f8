// Play of a simulated stage: what it carries follows its motor with backlash, and comes to rest a
// little beside the place, anew at each.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <random>

namespace vitreo::sim {

struct StagePlaySettings {
  double backlash = 0;  // m, the whole width: what a reversal loses
  double noise = 0;     // m, standard deviation at rest
  void check() const;   // throws std::invalid_argument naming the parameter
};

/// Play operator (Prandtl): carried = clamp(carried, motor - b/2, motor + b/2), plus a normal
/// number that is drawn when the motor has moved. Asked in the order of time; the same questions
/// have the same answers.
class StagePlay {
 public:
  StagePlay(const StagePlaySettings& settings, std::uint64_t seed);
  /// m, of a motor at `motor`.
  double carried(double motor);

 private:
  StagePlaySettings settings_;
  std::mt19937_64 random_;
  std::optional<double> motor_;
  double middle_ = 0;
  double beside_ = 0;
};

}  // namespace vitreo::sim
