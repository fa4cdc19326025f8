// Rolling of a turning sphere beside a wall by the fluid between them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace vitreo::control {

/// v / (w R) of a sphere of `radius` (m) on which no force acts, its center `distance` (m) from a
/// plane wall: what the fluid alone makes it roll, 1 being to roll without slip; along w x n.
/// Goldman, Cox & Brenner 1967: by lubrication within a tenth of the radius, by the method of
/// reflections farther away (8e-4 at two radii). Gaps below a thousandth of the radius count as
/// that: surfaces are rough. Throws std::invalid_argument for a radius or distance not above 0.
double fluid_rolling(double radius, double distance);

}  // namespace vitreo::control
