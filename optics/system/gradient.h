// Gradient of a medium's refractive index along and across the axis.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <array>

namespace vitreo::optics {

/// Index behind a surface, in the surface's own frame with r^2 = x^2 + y^2:
///  n = index + z1 z + z2 z^2 + z3 z^3 + z4 z^4 + r2 r^2 + r4 r^4 + r6 r^6,
/// `index` being the surface's, at its vertex. The form of Liou & Brennan (1997), of Goncharov &
/// Dainty (2007) and of OpticStudio's surface "Gradient 3".
struct Gradient {
  std::array<double, 4> along{};   // z1 to z4: m^-1 to m^-4
  std::array<double, 3> across{};  // r2, r4, r6: m^-2, m^-4, m^-6
  bool is_none() const {
    return along == std::array<double, 4>{} && across == std::array<double, 3>{};
  }
  /// What the gradient adds to the index at a point of the surface's frame, and its derivative.
  double value(const Eigen::Vector3d& p) const {
    const double r2 = p.x() * p.x() + p.y() * p.y();
    return p.z() * (along[0] + p.z() * (along[1] + p.z() * (along[2] + p.z() * along[3]))) +
           r2 * (across[0] + r2 * (across[1] + r2 * across[2]));
  }
  Eigen::Vector3d derivative(const Eigen::Vector3d& p) const {
    const double r2 = p.x() * p.x() + p.y() * p.y();
    const double radial = 2 * (across[0] + r2 * (2 * across[1] + r2 * (3 * across[2])));
    return {radial * p.x(), radial * p.y(),
            along[0] + p.z() * (2 * along[1] + p.z() * (3 * along[2] + p.z() * (4 * along[3])))};
  }
};

}  // namespace vitreo::optics
