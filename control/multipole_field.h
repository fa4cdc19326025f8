// Multipole field model (MPEM; Petruska, Edelmann & Nelson 2017): electromagnets as sources of
// solid harmonics.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/coil_field.h"

#include <Eigen/Core>

#include <vector>

namespace vitreo::control {

constexpr int kMaxMultipoleOrder = 12;

/// One source of a coil: Psi = sum over n = 1, 2, ... of (A_n r^n + B_n r^-(n+1)) P_n(cos th), th
/// from `axis` and r from `position`; B = +grad Psi, as in the software of ETH. So B_1 alone is the
/// dipole with mu0 m/4pi = -B_1 axis.
struct MultipoleSource {
  Eigen::Vector3d position{0, 0, 0};  // m, world
  Eigen::Vector3d axis{0, 0, 1};      // unit
  std::vector<double> regular;        // A_n, T m^(1-n)/A
  std::vector<double> irregular;      // B_n, T m^(n+2)/A
};

/// The box in which a model was fitted, and outside which it does not hold.
struct Region {
  Eigen::Vector3d low{0, 0, 0};   // m, world
  Eigen::Vector3d high{0, 0, 0};  // m, world
  bool contains(const Eigen::Vector3d& position_in_world) const;
};

class MultipoleField {
 public:
  using Sources = std::vector<MultipoleSource>;
  /// One entry of `coils` a coil, and the sources that are there without current (per 1 instead of
  /// per ampere). Throws std::invalid_argument for none or too many coils, an order above
  /// kMaxMultipoleOrder, an axis that is not unit to 1e-3 (it is then normalized), an empty region,
  /// numbers that are not finite.
  MultipoleField(std::vector<Sources> coils, Sources background, const Region& region);
  int coils() const { return static_cast<int>(coils_.size()); }
  /// Analytic. Throws std::domain_error outside the region, naming position and region;
  /// std::invalid_argument where the position is not finite or that of a source with irregular
  /// terms.
  FieldMatrix matrix(const Eigen::Vector3d& position_in_world) const;
  /// The field at zero current: T and T/m.
  FieldGradient background(const Eigen::Vector3d& position_in_world) const;
  const Region& region() const { return region_; }
  const std::vector<Sources>& sources() const { return coils_; }
  const Sources& background_sources() const { return background_; }

 private:
  void check_inside(const Eigen::Vector3d& position_in_world) const;

  std::vector<Sources> coils_;
  Sources background_;
  Region region_;
};

}  // namespace vitreo::control
