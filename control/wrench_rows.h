// Scaling and rank limit of the 6 x n matrix from currents to field and force.
// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace vitreo::control {

/// m: force over moment (T/m) times this stands beside field (T) in one matrix, so that its rows
/// are comparable (the D of facts/magnetics 2). About the distance over which the coils' field
/// falls by half.
constexpr double kGradientLength = 20e-3;

/// Least pivot of A A' over the largest at which A counts as of full rank. Inside the workspace
/// the condition of A stays below 13, so its square below 170; a lost rank shows as rounding,
/// 1e-16. At 1e-10 the currents would be ten thousand times those of a good pose.
constexpr double kSmallestPivot = 1e-10;

}  // namespace vitreo::control
