// SPDX-License-Identifier: Apache-2.0
#include "host/lua/reference/reference.h"

#include "host/config/config.h"
#include "host/lua/rig/classes.h"
#include "host/text/columns.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <stdexcept>
#include <string_view>
#include <utility>

namespace vitreo::lua {
namespace {

/// What people would write for a value of that dimension.
struct Usual {
  std::string_view dimension, unit;
  double number;
};
constexpr Usual kUsual[] = {{"m", "mm", 1},   {"s", "s", 5},       {"m/s", "mm_per_s", 0.5},
                            {"T", "mT", 10},  {"A", "A", 1},       {"rad", "deg", 5},
                            {"N", "uN", 1},   {"m/s^2", "", 2e-3}, {"kg/m^3", "", 1e3},
                            {"Hz", "Hz", 10}, {"m^2/s", "", 1e-6}};

/// The usual value of the dimension where it is within the bounds, else 0.5 or 2, else a bound: an
/// example must run.
std::string quantity_example(const Argument& argument) {
  for (const Usual& usual : kUsual) {
    if (usual.dimension != argument.unit) continue;
    const auto unit = std::find_if(units().begin(), units().end(), [&](const Unit& one) {
      return unit_name(one.symbol) == usual.unit;
    });
    const double factor = usual.unit.empty() || unit == units().end() ? 1 : unit->factor;
    const double value = usual.number * factor;
    if (value < argument.min || value > argument.max) break;
    return fmt::format("{:g}", usual.number) +
           (factor == 1 ? "" : fmt::format(" * units.{}", usual.unit));
  }
  double value = argument.type == Type::integer ? 2 : 0.5;
  if (value < argument.min || value > argument.max)
    value = std::isfinite(argument.min) ? argument.min : argument.max;
  return fmt::format("{:g}", value);
}

/// By the argument's name, since a text has no unit that would say what is wanted.
std::string text_example(const Argument& argument) {
  if (!argument.choices.empty()) return '"' + argument.choices.front() + '"';
  if (argument.name == "path") return "\"folder/file.png\"";
  if (argument.name == "camera") return "\"top_camera\"";
  if (argument.name == "stream" || argument.name == "of") return "\"servo\"";
  if (argument.name == "against") return "\"truth\"";
  if (argument.name == "unit") return "\"um\"";
  if (argument.name == "channel") return "\"x\"";
  return '"' + argument.name + '"';
}

std::string value_example(const Argument& argument);

/// What is needed, and the first of what may be left out: enough to show how options are written.
std::string options_example(const Argument& argument) {
  std::string text;
  bool optional_shown = false;
  for (const Argument& option : argument.options) {
    if (option.optional && optional_shown) continue;
    optional_shown = optional_shown || option.optional;
    text += (text.empty() ? "{ " : ", ") + option.name + " = " + value_example(option);
  }
  return text.empty() ? "{}" : text + " }";
}

std::string value_example(const Argument& argument) {
  switch (argument.type) {
    case Type::number:
    case Type::integer:
      return quantity_example(argument);
    case Type::flag:
      return "true";
    case Type::text:
      return text_example(argument);
    case Type::function:
      return "function() return true end";
    case Type::vector:
      return argument.unit == "m" ? "vector(0, 0, 1 * units.mm)" : "vector(0, 0, 1)";
    case Type::direction:
      return "vector(0, 0, 1)";
    case Type::numbers:
      return argument.unit == "A" ? "{ 1, 0, 0, 0, 0, 0, 0, 0 }" : "{ 1, 2, 3 }";
    case Type::list:
      return argument.unit == "m" ? "{ vector(0, 0, 0), vector(1 * units.mm, 0, 0) }"
                                  : "{ 1, 2, 3 }";
    case Type::table:
      return "{}";
    case Type::handle:
      return handle_name(argument.handle);
    case Type::options:
      return options_example(argument);
    case Type::any:
      return "1";
  }
  return "nil";
}

/// Options are listed as if they were arguments: their table has a name that nobody writes.
void show_argument(std::string& text, const Argument& argument, const std::string& indent) {
  if (argument.type == Type::options) {
    for (const Argument& option : options_by_name(argument)) show_argument(text, option, indent);
    return;
  }
  const std::string bounds = bounds_text(argument);
  text += indent + argument.name + ": " + wanted(argument) + (bounds.empty() ? "" : ", " + bounds) +
          (argument.optional ? ", may be left out" : "") +
          (argument.help.empty() ? "" : "; " + argument.help) + "\n";
}

/// "" where nothing begins with that name.
std::string module_help(const Library& library, const std::string& name) {
  std::string text;
  for (const Binding* row : all_functions(library))
    if (row->name.starts_with(name + "."))
      text += "  " + signature(nullptr, *row) + "\n      " + row->doc + "\n";
  return text.empty() ? ""
                      : name + ": a module; local " + name + " = require \"" + name +
                            "\" in a file\n" + text;
}

std::string units_help() {
  std::string text = "units: numbers are SI, so write 50 * units.um; units.NAME for NAME in\n ";
  for (const Unit& unit : units())
    if (const std::string name = unit_name(unit.symbol); !name.empty()) text += " " + name;
  return text + "\n";
}

/// Of "mm" and of "units.mm"; "" where it is none.
std::string unit_help(const std::string& word) {
  const std::string name = word.starts_with("units.") ? word.substr(6) : word;
  for (const Unit& unit : units())
    if (unit_name(unit.symbol) == name)
      return fmt::format("units.{}: {} of 1 {} is {:g} {} in SI\n", name, unit.quantity,
                         unit.symbol, unit.factor, unit.dimension);
  return "";
}

}  // namespace

std::vector<const Binding*> all_functions(const Library& library) {
  std::vector<const Binding*> all;
  const auto add = [&all](const std::vector<Binding>& rows) {
    for (const Binding& row : rows) all.push_back(&row);
  };
  add(*library.globals);
  add(*library.prompt);
  for (const Module& module : library.modules) add(*module.rows);
  return all;
}

std::vector<Entry> all_entries(const Library& library) {
  std::vector<Entry> entries;
  for (const Class* kind : library.classes)
    for (const Binding& row : kind->methods) entries.push_back({kind, &row});
  for (const Binding* row : all_functions(library)) entries.push_back({nullptr, row});
  return entries;
}

std::vector<std::string> module_names(const Library& library) {
  std::vector<std::string> names;
  for (const Binding* row : all_functions(library)) {
    for (std::size_t dot = row->name.find('.'); dot != std::string::npos;
         dot = row->name.find('.', dot + 1))
      if (std::find(names.begin(), names.end(), row->name.substr(0, dot)) == names.end())
        names.push_back(row->name.substr(0, dot));
  }
  return names;
}

const Class* find_class(const Library& library, const std::string& name) {
  for (const Class* kind : library.classes)
    if (kind->name == name) return kind;
  return nullptr;
}

std::vector<Argument> options_by_name(const Argument& argument) {
  std::vector<Argument> named;
  for (const Argument& option : argument.options) {
    if (option.type != Type::options) {
      named.push_back(option);
      continue;
    }
    named.push_back({.name = option.name,
                     .type = Type::table,
                     .optional = option.optional,
                     .help = option.help});
    for (Argument& inner : options_by_name(option)) {
      inner.name = option.name + "." + inner.name;
      named.push_back(std::move(inner));
    }
  }
  return named;
}

// Full names come first: "check" is the prompt's function, whatever class has a method of that
// name.
std::optional<Entry> find_entry(const Library& library, const std::string& name) {
  const std::vector<Entry> entries = all_entries(library);
  for (const Entry& entry : entries)
    if (full_name(entry.owner, *entry.row) == name ||
        (entry.owner != nullptr && entry.owner->name + "." + entry.row->name == name))
      return entry;
  for (const Entry& entry : entries)
    if (entry.row->name == name) return entry;
  return std::nullopt;
}

// Roles are fields of the rig under the name of their class; the exceptions stand in the table. Any
// other class is called by its own name, as tests/host/lua/reference/examples_test.cpp declares it.
std::string handle_name(const std::string& kind) {
  constexpr std::pair<std::string_view, const char*> kNames[] = {
      {"camera", "rig.top_camera"}, {"optical_system", "eye"}, {"wide_angle_map", "map"},
      {"localizer", "view"},        {"axis_law", "law"},       {"trajectory", "path"},
      {"autofocus", "search"}};
  for (const auto& [of, name] : kNames)
    if (of == kind) return name;
  const std::vector<std::string>& roles = rig_class().fields;
  return std::find(roles.begin(), roles.end(), kind) != roles.end() ? "rig." + kind : kind;
}

// f { a = 1 } instead of f({ a = 1 }) where a table is all that the call takes, as scripts write
// it.
std::string example(const Entry& entry) {
  if (!entry.row->example.empty()) return entry.row->example;
  std::string arguments;
  for (const Argument& argument : entry.row->arguments) {
    const bool all_optional = argument.type == Type::options && argument.options.empty();
    if (argument.optional || all_optional) continue;
    arguments += (arguments.empty() ? "" : ", ") +
                 (argument.name == "..." ? "function() return true end" : value_example(argument));
  }
  const std::string owner = entry.owner != nullptr ? handle_name(entry.owner->name) + ":" : "";
  const std::string call = owner + entry.row->name;
  const bool one_table = arguments.starts_with("{") && entry.row->arguments.size() == 1;
  return one_table ? call + " " + arguments : call + "(" + arguments + ")";
}

namespace {

/// By name alone, through all levels: the prompt meets a field without the way to it. Of two with
/// one name the unit of the one that the row has first holds.
void collect_units(const std::vector<ResultField>& fields,
                   std::map<std::string, std::string>& units) {
  for (const ResultField& field : fields) {
    if (!field.unit.empty()) units.emplace(field.name, field.unit);
    collect_units(field.fields, units);
  }
}

void show_fields(std::string& text, const std::vector<ResultField>& fields,
                 const std::string& indent) {
  for (const ResultField& field : fields) {
    text += indent + field.name + (field.unit.empty() ? "" : " in " + field.unit) +
            (field.optional ? ", or nil" : "") + (field.help.empty() ? "" : ": " + field.help) +
            "\n";
    show_fields(text, field.fields, indent + "  ");
  }
}

}  // namespace

std::string bounds_text(const Argument& argument) {
  if (argument.type != Type::number && argument.type != Type::integer) return "";
  const bool below = std::isfinite(argument.min), above = std::isfinite(argument.max);
  if (below && above) return format_range(argument.min, argument.max, argument.unit);
  if (below) return "at least " + format_quantity(argument.min, argument.unit);
  return above ? "at most " + format_quantity(argument.max, argument.unit) : "";
}

std::string unit_of_result(const Binding& row) { return row.returns.unit; }

std::map<std::string, std::string> units_of_fields(const Binding& row) {
  std::map<std::string, std::string> units;
  collect_units(row.returns.fields, units);
  return units;
}

std::string entry_help(const Entry& entry) {
  std::string text = signature(entry.owner, *entry.row) + "\n  " + entry.row->doc + "\n";
  for (const Argument& argument : entry.row->arguments) show_argument(text, argument, "    ");
  if (!entry.row->returns.fields.empty()) {
    text += "  returns a " + entry.row->returns.text() + ":\n";
    show_fields(text, entry.row->returns.fields, "    ");
  }
  return text + "  for instance: " + example(entry) + "\n";
}

std::string class_help(const Class& kind) {
  std::string text = kind.name + ": " + kind.doc + "\n";
  for (const Binding& method : kind.methods)
    text += "  " + signature(&kind, method) + "\n      " + method.doc + "\n";
  return text;
}

std::string overview(const Library& library) {
  std::string text =
      "help(\"servo\") or help(servo) tells more about one of these, help(\"servo:go_to\") about a "
      "call; servo? is "
      "short for it:\n";
  for (const Class* kind : library.classes) text += "  " + kind->name + ": " + kind->doc + "\n";
  for (const Binding* function : all_functions(library))
    text += "  " + signature(nullptr, *function) + ": " + function->doc + "\n";
  return text +
         "  units: units.mm, units.mm_per_s ...: numbers are SI, so write 50*units.um\n"
         "  vector(x, y, z): a vector with arithmetic; v.x, v:norm()\n";
}

// At the beginning of a word: "image" finds images, and "age" finds no image.
std::string topic_help(const Library& library, const std::string& word) {
  constexpr int kMost = 30;
  const auto has = [&word](const std::string& text) {
    std::string low;
    for (const char c : text) low += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    for (std::size_t at = low.find(word); at != std::string::npos; at = low.find(word, at + 1))
      if (at == 0 || std::isalpha(static_cast<unsigned char>(low[at - 1])) == 0) return true;
    return false;
  };
  std::string text;
  int count = 0;
  for (const Entry& entry : all_entries(library)) {
    if (!has(entry.row->name) && !has(entry.row->doc)) continue;
    if (++count > kMost) return text + "  and more: docs/reference/api.md has all of them\n";
    text += "  " + full_name(entry.owner, *entry.row) + ": " + entry.row->doc + "\n";
  }
  return text;
}

// From the certain to the doubtful: a class, a call by its full name, a module, the units, a method
// by its name alone, a unit. "servo" is the class, and rig:servo has to be named in full.
std::string help_about(const Library& library, const std::string& word) {
  if (const Class* const kind = find_class(library, word)) return class_help(*kind);
  std::vector<std::string> known;
  for (const Class* kind : library.classes) known.push_back(kind->name);
  for (const Entry& entry : all_entries(library))
    known.push_back(full_name(entry.owner, *entry.row));
  if (std::find(known.begin(), known.end(), word) != known.end() ||
      word.find(':') != std::string::npos)
    if (const auto entry = find_entry(library, word)) return entry_help(*entry);
  if (std::string text = module_help(library, word); !text.empty()) return text;
  if (word == "units") return units_help();
  if (const auto entry = find_entry(library, word)) return entry_help(*entry);
  if (std::string text = unit_help(word); !text.empty()) return text;
  constexpr std::string_view kRole = "rig.";
  const std::string near =
      nearest(word.starts_with(kRole) ? word.substr(kRole.size()) : word, known);
  throw std::invalid_argument("nothing is called " + word +
                              (near.empty() ? "" : "; did you mean " + near + "?"));
}

}  // namespace vitreo::lua
