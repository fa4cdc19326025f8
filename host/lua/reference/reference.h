// Queries on the rows of the bindings: for help(), completion, editors' stubs, the checker of
// scripts and the reference in the docs.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/library.h"

#include <map>
#include <optional>
#include <string>
#include <vector>

namespace vitreo::lua {

/// One call: a method of a class, or a function (its name may have dots).
struct Entry {
  const Class* owner = nullptr;
  const Binding* row = nullptr;
};

/// The functions without a class, those of modules among them.
std::vector<const Binding*> all_functions(const Library& library);
/// Every call, classes first.
std::vector<Entry> all_entries(const Library& library);
/// Calls whose name or line of help has the word, as lines; "" where there is none.
std::string topic_help(const Library& library, const std::string& word);
/// "control", "vision", "vision.focus", ...: what stands before a function's last dot.
std::vector<std::string> module_names(const Library& library);
/// "servo:go_to", "servo.go_to", "control.line"; a method's name alone where no function has it.
std::optional<Entry> find_entry(const Library& library, const std::string& name);
const Class* find_class(const Library& library, const std::string& name);

/// What stands before every example: the names of units.
inline constexpr const char* kExampleNames =
    "local units = require \"units\"\n"
    "local m, cm, mm, um, nm = units.m, units.cm, units.mm, units.um, units.nm\n"
    "local s, ms, mT, A, deg, Hz = units.s, units.ms, units.mT, units.A, units.deg, units.Hz\n";
/// The name of a handle in examples: "rig.stage", "servo", "eye".
std::string handle_name(const std::string& kind);
/// A call that could stand in a script: the row's own, or one made from its arguments' types, units
/// and bounds.
std::string example(const Entry& entry);
/// What an options table takes, for a list of arguments: its keys; of a table among options, the
/// table itself and then its keys by both names, "microscope.focus".
std::vector<Argument> options_by_name(const Argument& argument);
/// Of a number: "0.5 to 60 s", "at least 1", "" where it has no bounds.
std::string bounds_text(const Argument& argument);
/// The SI unit of a number, a vector or a list of numbers that the call returns; "" else.
std::string unit_of_result(const Binding& row);
/// Of a call that returns tables: the SI units of their fields, those of tables in them too.
std::map<std::string, std::string> units_of_fields(const Binding& row);

/// Signature, text, arguments with units and bounds, an example.
std::string entry_help(const Entry& entry);
std::string class_help(const Class& kind);
/// Everything in a line each.
std::string overview(const Library& library);
/// Of a class, a call, a module, a unit; throws std::invalid_argument with what was perhaps meant.
std::string help_about(const Library& library, const std::string& word);

}  // namespace vitreo::lua
