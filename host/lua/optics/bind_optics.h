// Shared parts of the bindings of the optics. An optical_system's object is an
// optics::Prescription.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/tables.h"
#include "optics/rays/observer.h"
#include "optics/system/prescriptions.h"

#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace vitreo::lua {

void push_system(lua_State* L, optics::Prescription prescription);
/// The handle's prescription.
optics::Prescription& eye_of(const Call& call);

Argument length_option(const char* name, double min, double max, const char* help);
/// The option `microscope`, and what it says; nothing: a bare sensor.
Argument microscope_argument();
std::optional<optics::Microscope> microscope_option(const Call& call);

/// A system as a script writes it down: {name, title, source, stop = {surface, radius}, rows =
/// {...}}.
optics::Prescription prescription_table_at(lua_State* L, int index);

/// The rows of optical_system, by file.
std::vector<Binding> system_table_rows();
std::vector<Binding> system_first_order_rows();
std::vector<Binding> system_ray_rows();
std::vector<Binding> system_wave_rows();
std::vector<Binding> system_map_rows();
std::vector<Binding> system_tolerance_rows();
std::vector<Binding> system_pose_rows();
std::vector<Binding> system_chain_rows();
std::vector<Binding> system_calibration_rows();
std::vector<Binding> system_design_rows();
/// And of the module.
std::vector<Binding> calibration_functions();

}  // namespace vitreo::lua
