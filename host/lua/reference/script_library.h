// Reference of the Lua library in scripts/: its modules and functions, read from the comments of
// their sources.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace vitreo::lua {

/// A function that a module exports, or a method of its objects.
struct ScriptFunction {
  std::string name;       // as the source has it: "statistics.mean", "book:number"
  std::string arguments;  // "run, options"
  std::string text;       // of the lines with --- above it; "" without
  /// Fields of its last argument `options` that its body reads, each with what it takes without, as
  /// the source has it: "within (400 * um)", "width".
  std::vector<std::string> options;
};

/// "bring.trim(servo, center, options)", as help and reference show it.
std::string title_of(const ScriptFunction& function);
/// Its comment, and its options.
std::string description_of(const ScriptFunction& function);

struct ScriptModule {
  std::string name;     // for require: "analysis.statistics"
  std::string table;    // what the source calls what it returns: "statistics"; "" for plain data
  std::string purpose;  // the comment at the source's head
  std::vector<ScriptFunction> functions;  // in the order of the source
};

/// Of a source: every function that is not local and stands at a line's beginning.
ScriptModule read_script_module(const std::string& name, const std::string& source);
/// The modules below a folder, by name; its rigs are no modules. Throws ScriptError for a file that
/// cannot be read, std::filesystem::filesystem_error for a folder that is not there.
std::vector<ScriptModule> script_modules(const std::filesystem::path& folder);

}  // namespace vitreo::lua
