// What the bindings of the optics share. An optical_system's object is an optics::Prescription.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/binding.h"
#include "optics/observer.h"
#include "optics/prescriptions.h"

#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace vitreo::lua {

using Field = std::pair<const char*, double>;

/// A table of them. What is not finite is left out: nil, not a NaN that travels on.
void push_fields(lua_State* L, const std::vector<Field>& fields);
void set_fields(lua_State* L, const std::vector<Field>& fields);  // into the table on top
void push_numbers(lua_State* L, const std::vector<double>& numbers);
void push_system(lua_State* L, optics::Prescription prescription);
/// The handle's prescription.
optics::Prescription& eye_of(const Call& call);

/// An options table by itself, where a call has several, or an entry of a list. Checked options have the right types;
/// of an entry, a field of another type counts as absent.
class OptionTable {
 public:
  OptionTable(lua_State* state, int index) : L_(state), index_(index) {}
  OptionTable(const Call& call, std::size_t argument) : OptionTable(call.L, call.index(argument)) {}
  std::optional<double> number(const char* name) const;
  std::optional<std::string> text(const char* name) const;
  std::optional<std::vector<double>> numbers(const char* name) const;
  std::optional<Eigen::Vector3d> vector(const char* name) const;
  bool flag(const char* name) const;

 private:
  int get(const char* name) const;  // pushes the field, or nil
  lua_State* L_;
  int index_;
};

Argument length_option(const char* name, double min, double max, const char* help);
Argument options_of(std::vector<Argument> options);
/// The option `microscope`, and what it says; nothing: a bare sensor.
Argument microscope_argument();
std::optional<optics::Microscope> microscope_option(const Call& call);

/// A system as a script writes it down, and back: {name, title, source, stop = {surface, radius}, rows = {...}}.
void push_prescription_table(lua_State* L, const optics::Prescription& prescription);
optics::Prescription prescription_table_at(lua_State* L, int index);

/// The rows of optical_system, by file.
std::vector<Binding> system_table_rows();
std::vector<Binding> system_first_order_rows();
std::vector<Binding> system_ray_rows();
std::vector<Binding> system_map_rows();
std::vector<Binding> system_tolerance_rows();
std::vector<Binding> system_pose_rows();
std::vector<Binding> system_calibration_rows();
std::vector<Binding> system_design_rows();
/// And of the module.
std::vector<Binding> calibration_functions();

}  // namespace vitreo::lua
