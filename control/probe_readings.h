// Field probe readings, and how well a field model agrees with them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/coil_field.h"

#include <Eigen/Core>

#include <cstddef>
#include <functional>
#include <vector>

namespace vitreo::control {

struct ProbeReading {
  Eigen::Vector3d position{0, 0, 0};  // m, world
  Currents currents;                  // A
  Eigen::Vector3d field{0, 0, 0};     // T
};

/// Throws std::invalid_argument naming the reading that is not finite or has not one current a
/// coil, for fewer than `needed`, and for a coil that never had a current of its own: its column in
/// the readings' currents is a mixture of the others' and of the background's.
void check_readings(const std::vector<ProbeReading>& readings, int coils, std::size_t needed);

struct ResidualReport {
  double rms = 0;         // T, of one component
  double largest = 0;     // T, the length of the worst reading's miss
  std::size_t worst = 0;  // which reading that is
  double relative = 0;    // of the readings' own rms
};

/// `model`: the field in T that it has for a reading.
ResidualReport residual_report(const std::vector<ProbeReading>& readings,
                               const std::function<Eigen::Vector3d(const ProbeReading&)>& model);

}  // namespace vitreo::control
