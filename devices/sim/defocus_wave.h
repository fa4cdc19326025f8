// Wave of a circular aperture out of focus: what a microscope's image of a point is where geometry
// is not enough.
// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace vitreo::sim {

/// Intensity at v = 2 pi NA r / lambda from the axis, u = 2 pi NA^2 defocus / lambda out of focus,
/// over that in focus on the axis (Born & Wolf 1999, 8.8.1):
/// |2 integral_0^1 J_0(v rho) exp(-i u rho^2 / 2) rho d rho|^2. Geometry's disc ends at |v| = |u|.
double defocused_intensity(double u, double v);

}  // namespace vitreo::sim
