// Predictive keep-out: a quadratic program over the next frames with the margin, the coils'
// currents and their heat as constraints. Measured against control/keep_out, and not kept in the
// product (docs/control.md has the figures).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/clearance.h"
#include "control/coil_field.h"
#include "control/keep_out.h"

#include <Eigen/Core>

#include <vector>

namespace vitreo::approaches {

/// Currents of a commanded velocity, by the allocation without limits: I = rest + slope u.
struct CurrentMap {
  control::Currents rest;                          // A, levitation alone
  Eigen::Matrix<double, Eigen::Dynamic, 3> slope;  // A s/m
};

struct PredictiveSettings {
  double margin = 0.2e-3;  // m
  int frames = 6;
  double period = 1 / 15.0;  // s
  double current = 12;       // A
  // Heat of each coil, K over ambient, and its limit; C dT/dt = R I^2 - T / R_th.
  double temperature = 0;
  double temperature_limit = 80;
  double resistance = 1;
  double heat_capacity = 770;
  double thermal_resistance = 0.5;
};

struct PredictiveResult {
  Eigen::Vector3d velocity{0, 0, 0};  // m/s, commanded in the first frame
  int sweeps = 0;
  double violation = 0;  // of the constraints, scaled, that is left
};

/// min sum |u_k - wanted|^2 with, for k = 1 .. frames,
///   n.(p_k - p_0) >= margin - bound of both walls, p_k = p_0 + sum Ts (d + (1 + g) u_j),
///   |rest + slope u_k| <= the largest current that neither the amplifier nor, held to the
///   horizon's end, the coil's temperature forbids.
/// Hildreth's dual coordinate ascent (1957).
PredictiveResult predictive_keep_out(const PredictiveSettings& settings,
                                     const control::Clearance& clearance,
                                     const Eigen::Vector3d& wanted,
                                     const Eigen::Vector3d& disturbance, double response,
                                     const CurrentMap& currents);

}  // namespace vitreo::approaches
