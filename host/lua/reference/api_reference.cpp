// SPDX-License-Identifier: Apache-2.0
#include "host/lua/reference/api_reference.h"

#include "host/lua/reference/everyday_calls.h"
#include "host/lua/reference/reference.h"
#include "host/text/units.h"

#include <fmt/format.h>

#include <cmath>

namespace vitreo::lua {
namespace {

/// A bar within a cell would end it.
std::string cell(std::string text) {
  for (std::size_t at = 0; (at = text.find('|', at)) != std::string::npos; at += 2)
    text.insert(at, "\\");
  return text;
}

/// A line of the table for each argument; options stand for themselves, not for their table.
void reference_arguments(const std::vector<Argument>& arguments, std::string& text) {
  for (const Argument& argument : arguments) {
    if (argument.type == Type::options) {
      reference_arguments(options_by_name(argument), text);
      continue;
    }
    text += fmt::format("| `{}`{} | {} | {} | {} |\n", argument.name,
                        argument.optional ? "" : " (needed)", cell(wanted(argument)),
                        bounds_text(argument), cell(argument.help));
  }
}

/// Fields of tables in the table have the way to them: "after.span".
void reference_fields(const std::vector<ResultField>& fields, const std::string& before,
                      std::string& text) {
  for (const ResultField& field : fields) {
    text += fmt::format("| `{}{}`{} | {} | {} |\n", before, field.name,
                        field.optional ? " (or nil)" : "", field.unit, cell(field.help));
    reference_fields(field.fields, before + field.name + ".", text);
  }
}

std::string reference_of(const Entry& entry) {
  std::string text = "### `" + full_name(entry.owner, *entry.row) + "`\n\n`" +
                     signature(entry.owner, *entry.row) + "`\n\n" + entry.row->doc +
                     ".\n\n```lua\n" + example(entry) + "\n```\n\n";
  std::string rows;
  reference_arguments(entry.row->arguments, rows);
  if (!rows.empty()) text += "| argument | takes | bounds | |\n|---|---|---|---|\n" + rows + "\n";
  std::string fields;
  reference_fields(entry.row->returns.fields, "", fields);
  if (!fields.empty()) text += "| field of the result | in | |\n|---|---|---|\n" + fields + "\n";
  return text;
}

constexpr const char* kIntroduction =
    "# What scripts can call\n\nPrinted by the program from its own tables: `vitreo docs api`. "
    "Numbers are SI; "
    "`local units = require \"units\"`\ngives the factors. At the prompt `help(\"servo:go_to\")` "
    "or `servo:go_to?` "
    "says the same.\n\nWhat is absent is nil: a robot that is not seen, a ray that misses. What "
    "fails raises an error that\nnames the call and the argument. A call returns one value; "
    "several are the fields of a table.\n"
    "\nA test runs every example in a simulated rig. Handles are called by their class there, an "
    "optical_system `eye`,\na wide_angle_map `map`, a localizer `view`, an axis_law `law`, a "
    "trajectory `path`, an autofocus `search`; units by\n\n```lua\n";

/// Each of the everyday calls in a line; what the reference says of it stands under its own name.
std::string card(const Library& library) {
  std::string text =
      fmt::format("\n## A technician's script needs these {}\n\n| call | |\n|---|---|\n",
                  std::size(kEverydayCalls));
  for (const char* const name : kEverydayCalls)
    if (const auto entry = find_entry(library, name))
      text += fmt::format("| `{}` | {} |\n", signature(entry->owner, *entry->row),
                          cell(entry->row->doc));
  return text;
}

std::string classes_reference(const Library& library) {
  std::string text;
  for (const Class* kind : library.classes) {
    text += "\n## " + kind->name + "\n\n" + kind->doc + ".\n\n";
    for (const Binding& row : kind->methods) text += reference_of({kind, &row});
  }
  return text;
}

/// The functions without a class, each module's under a heading of its own.
std::string functions_reference(const Library& library) {
  std::string text;
  std::string module = "?";
  for (const Binding* row : all_functions(library)) {
    const std::size_t dot = row->name.find('.');
    const std::string name = dot == std::string::npos ? "" : row->name.substr(0, dot);
    if (name != module)
      text += "\n## " + (name.empty() ? std::string("Everywhere") : "module " + name) + "\n\n";
    module = name;
    text += reference_of({nullptr, row});
  }
  return text;
}

std::string units_reference() {
  std::string text = "\n## units\n\n| name | unit | measures | SI |\n|---|---|---|---|\n";
  for (const Unit& unit : units())
    if (const std::string name = unit_name(unit.symbol); !name.empty())
      text += fmt::format("| `units.{}` | {} | {} | {:g} {} |\n", name, unit.symbol, unit.quantity,
                          unit.factor, unit.dimension);
  return text +
         "\nTemperatures are in K in scripts; a parameter of the unit `degC` is typed as "
         "`warmest=22degC`, its `default`, `min` and `max` are in K (`default = 295.15`), and so "
         "is what the script gets.\n";
}

std::string scripts_reference(const std::vector<ScriptModule>& modules) {
  std::string text =
      "\n## Modules written in Lua\n\nIn the folder `scripts/`; the texts are the comments there, "
      "which the Lua language server shows, too.\n";
  for (const ScriptModule& module : modules) {
    text += "\n### `" + module.name + "`\n\n" + module.purpose + "\n";
    if (!module.table.empty())
      text += "\n```lua\nlocal " + module.table + " = require \"" + module.name + "\"\n```\n";
    if (!module.functions.empty()) text += "\n| call | |\n|---|---|\n";
    for (const ScriptFunction& function : module.functions)
      text += fmt::format("| `{}` | {} |\n", title_of(function), cell(description_of(function)));
  }
  return text;
}

}  // namespace

std::string api_reference(const Library& library, const std::vector<ScriptModule>& scripts) {
  return kIntroduction + std::string(kExampleNames) + "```\n" + card(library) +
         classes_reference(library) + functions_reference(library) + units_reference() +
         scripts_reference(scripts);
}

}  // namespace vitreo::lua
