// SPDX-License-Identifier: Apache-2.0
#include "control/field_calibration.h"

#include <cmath>
#include <stdexcept>
#include <string>

namespace vitreo::control {

// Sign, gain and angle of each coil's field against the reference at one position. A coil that is
// connected the wrong way round has the sign -1 with a gain near 1 and a small angle; a wrong coil
// has a large angle.
std::vector<CoilComparison> compare_coils(const FieldModel& model, const FieldModel& reference,
                                          const Eigen::Vector3d& position_in_world) {
  if (model.coils() != reference.coils())
    throw std::invalid_argument("it has " + std::to_string(model.coils()) +
                                " coils, the reference " + std::to_string(reference.coils()));
  // Rows 0 to 2 of the 8 x n matrix: B in T/A of each coil.
  const auto own = model.matrix(position_in_world).topRows<3>().eval();
  const auto other = reference.matrix(position_in_world).topRows<3>().eval();
  std::vector<CoilComparison> coils;
  for (Eigen::Index k = 0; k < own.cols(); ++k) {
    const Eigen::Vector3d b = own.col(k);
    const Eigen::Vector3d b0 = other.col(k);
    // atan2 of sine and cosine: exact near 0, where the arc cosine loses half of the digits.
    const double along = b.dot(b0);
    coils.push_back({along < 0 ? -1 : 1, b.norm() / b0.norm(),
                     std::atan2(b.cross(b0).norm(), std::abs(along))});
  }
  return coils;
}

}  // namespace vitreo::control
