// help(): printed from the rows of the bindings.
// SPDX-License-Identifier: Apache-2.0
#include "host/config.h"
#include "host/lua/bind_control.h"
#include "host/lua/binding.h"
#include "host/lua/context.h"
#include "host/lua/values.h"

#include <stdexcept>

namespace vitreo::lua {
namespace {

void show_argument(std::string& text, const Argument& argument, const std::string& indent) {
  if (argument.type == Type::options) {
    for (const Argument& option : argument.options) show_argument(text, option, indent);
    return;
  }
  text += indent + argument.name + ": " + wanted(argument) + (argument.optional ? ", may be left out" : "") +
          (argument.help.empty() ? "" : "; " + argument.help) + "\n";
}

std::string row_help(const Class* owner, const Binding& binding) {
  std::string text = signature(owner, binding) + "\n  " + binding.doc + "\n";
  for (const Argument& argument : binding.arguments) show_argument(text, argument, "    ");
  return text;
}

std::string class_help(const Class& kind) {
  std::string text = kind.name + ": " + kind.doc + "\n";
  for (const Binding& method : kind.methods) text += "  " + signature(&kind, method) + "\n      " + method.doc + "\n";
  return text;
}

std::vector<const Binding*> functions() {
  std::vector<const Binding*> all;
  for (const auto* rows :
       {&global_functions(), &optics_functions(), &control_functions(), &vision_functions(), &files_functions()})
    for (const Binding& row : *rows) all.push_back(&row);
  return all;
}

/// The functions of a module; "" where there are none.
std::string module_help(const std::string& name) {
  std::string text;
  for (const Binding* row : functions())
    if (row->name.starts_with(name + ".")) text += "  " + signature(nullptr, *row) + "\n      " + row->doc + "\n";
  return text.empty() ? "" : name + ": a module\n" + text;
}

std::string overview() {
  std::string text =
      "help(\"servo\") or help(servo) tells more about one of these, help(\"servo:go_to\") about a call:\n";
  for (const Class* kind : all_classes()) text += "  " + kind->name + ": " + kind->doc + "\n";
  for (const Binding* function : functions())
    text += "  " + signature(nullptr, *function) + ": " + function->doc + "\n";
  return text +
         "  units: units.mm, units.mm_per_s ...: numbers are SI, so write 50*units.um\n"
         "  vector(x, y, z): a position with arithmetic; v.x, v:norm()\n";
}

std::string help_about(const std::string& word) {
  std::vector<std::string> known;
  for (const Class* kind : all_classes()) {
    if (kind->name == word) return class_help(*kind);
    known.push_back(kind->name);
    for (const Binding& method : kind->methods) {
      known.push_back(full_name(kind, method));
      if (known.back() == word || kind->name + "." + method.name == word) return row_help(kind, method);
    }
  }
  for (const Binding* function : functions()) {
    known.push_back(function->name);
    if (function->name == word) return row_help(nullptr, *function);
  }
  if (std::string text = module_help(word); !text.empty()) return text;
  for (const Class* kind : all_classes())  // the method's name alone
    for (const Binding& method : kind->methods)
      if (method.name == word) return row_help(kind, method);
  const std::string near = nearest(word, known);
  throw std::invalid_argument("nothing is called " + word + (near.empty() ? "" : "; did you mean " + near + "?"));
}

int help(Call& call) {
  std::string text;
  if (!call.has(0))
    text = overview();
  else if (const Class* const kind = handle_class(call.L, call.index(0)))
    text = class_help(*kind);
  else
    text = help_about(call.text(0));
  while (text.ends_with('\n')) text.pop_back();
  if (const auto& print = call.context().print) print(text);
  return 0;
}

}  // namespace

const std::vector<Binding>& global_functions() {
  static const std::vector<Binding> functions = {
      {"help", {{.name = "about", .optional = true, .help = "a name or an object"}}, "", "tells what there is", help}};
  return functions;
}

}  // namespace vitreo::lua
