// SPDX-License-Identifier: Apache-2.0
#include "optics/system/surface_fields.h"

namespace vitreo::optics {
namespace {

/// One list for parameters by name, for scripts' rows and for their check, so that a number cannot
/// be known to one of them alone. Lengths in m, angles in rad, gradients in powers of 1/m.
constexpr SurfaceField kFields[] = {
    {"radius_y", "m", false, [](Surface& s) -> double& { return s.radius_y; }},
    {"conic_y", "1", false, [](Surface& s) -> double& { return s.conic_y; }},
    {"decenter_x", "m", false, [](Surface& s) -> double& { return s.placement.decenter[0]; }},
    {"decenter_y", "m", false, [](Surface& s) -> double& { return s.placement.decenter[1]; }},
    {"decenter_z", "m", false, [](Surface& s) -> double& { return s.placement.decenter[2]; }},
    {"tilt_x", "rad", false, [](Surface& s) -> double& { return s.placement.tilt[0]; }},
    {"tilt_y", "rad", false, [](Surface& s) -> double& { return s.placement.tilt[1]; }},
    {"tilt_z", "rad", false, [](Surface& s) -> double& { return s.placement.tilt[2]; }},
    {"gradient_z1", "m^-1", true, [](Surface& s) -> double& { return s.gradient.along[0]; }},
    {"gradient_z2", "m^-2", true, [](Surface& s) -> double& { return s.gradient.along[1]; }},
    {"gradient_z3", "m^-3", true, [](Surface& s) -> double& { return s.gradient.along[2]; }},
    {"gradient_z4", "m^-4", true, [](Surface& s) -> double& { return s.gradient.along[3]; }},
    {"gradient_r2", "m^-2", true, [](Surface& s) -> double& { return s.gradient.across[0]; }},
    {"gradient_r4", "m^-4", true, [](Surface& s) -> double& { return s.gradient.across[1]; }},
    {"gradient_r6", "m^-6", true, [](Surface& s) -> double& { return s.gradient.across[2]; }},
};

}  // namespace

std::span<const SurfaceField> surface_fields() { return kFields; }

}  // namespace vitreo::optics
