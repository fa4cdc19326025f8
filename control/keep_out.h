// Keep-out margin: the velocity nearest to a wanted one with which a body's surface does not come
// nearer to retina and lens than the margin (a control barrier; docs/control.md).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/clearance.h"

#include <Eigen/Core>

namespace vitreo::control {

struct KeepOut {
  double margin = 0.2e-3;  // m, of the clearance's lower bound
  /// 1/s: towards the margin at most this times the distance that is left, and inside of it back at
  /// this times what is missing. Below the loop's own bandwidth.
  double rate = 1.5;
  double max_retreat = 0.5e-3;  // m/s, of the way back
  void check() const;           // throws std::invalid_argument naming the setting
};

struct KeptOut {
  Eigen::Vector3d velocity{0, 0, 0};  // m/s
  bool limited = false;               // it is not the wanted one
};

/// min |v - wanted|^2 with n.v >= -rate (b - margin) for both walls: b is the lower bound of the
/// wall's clearance, n its normal. `wanted`: m/s, of the body, whatever moves it.
KeptOut keep_out(const KeepOut& settings, const Clearance& clearance,
                 const Eigen::Vector3d& wanted);

}  // namespace vitreo::control
