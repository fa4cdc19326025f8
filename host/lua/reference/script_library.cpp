// SPDX-License-Identifier: Apache-2.0
#include "host/lua/reference/script_library.h"

#include "host/lua/interpreter/state.h"

#include <algorithm>
#include <regex>
#include <sstream>
#include <string_view>

namespace vitreo::lua {
namespace {

constexpr std::string_view kFunction = "function ";
constexpr std::string_view kReturn = "return ";

/// What a line of a comment says after its dashes ("--" or "---"), joined to what the lines before
/// it said.
void add_comment(std::string& text, std::string_view line, std::string_view dashes) {
  line.remove_prefix(dashes.size());
  if (line.starts_with(' ')) line.remove_prefix(1);
  text += (text.empty() || line.empty() ? "" : " ") + std::string(line);
}

/// The head of a function may go over several lines: to its closing bracket. Arguments are names,
/// so the first bracket that closes is the list's.
ScriptFunction read_function(std::string head, std::istream& in) {
  for (std::string line; head.find(')') == std::string::npos && std::getline(in, line);)
    head += " " + line.substr(std::min(line.find_first_not_of(' '), line.size()));
  const std::size_t open = head.find('(');
  const std::size_t close = head.find(')', open);
  ScriptFunction function;
  function.name = head.substr(kFunction.size(), open - kFunction.size());
  function.arguments = head.substr(open + 1, close - open - 1);
  while (function.arguments.starts_with(' ')) function.arguments.erase(0, 1);
  while (function.arguments.ends_with(' ')) function.arguments.pop_back();
  return function;
}

/// Of a line of the body: "options.within or 400 * um" is the field `within`.
void add_options(ScriptFunction& function, const std::string& line) {
  static const std::regex read(R"(\boptions\.([A-Za-z_]\w*)(?:\s+or\s+([^,(){}]*[^,(){}\s]))?)");
  for (std::sregex_iterator at(line.begin(), line.end(), read), end; at != end; ++at) {
    const std::string name = (*at)[1];
    // Up to the statement's next word; of a call or a table the source itself has to be read.
    const std::string otherwise =
        std::regex_replace((*at)[2].str(), std::regex(R"(\s+(do|then|and|or)\b.*)"), "");
    const auto known = std::find_if(
        function.options.begin(), function.options.end(),
        [&](const std::string& one) { return one == name || one.starts_with(name + " ("); });
    if (known != function.options.end()) continue;
    const std::string after = at->suffix();
    const bool shown = !otherwise.empty() && !after.starts_with('(') && !after.starts_with('{');
    function.options.push_back(shown ? name + " (" + otherwise + ")" : name);
  }
}

bool is_name(std::string_view word) {
  return !word.empty() && std::all_of(word.begin(), word.end(), [](unsigned char c) {
    return std::isalnum(c) != 0 || c == '_';
  });
}

/// "analysis/statistics.lua" is the module analysis.statistics.
std::string module_name(const std::filesystem::path& relative) {
  std::string name = std::filesystem::path(relative).replace_extension().string();
  std::replace(name.begin(), name.end(), '/', '.');
  return name;
}

}  // namespace

// The comment of a function ends at the function, or at any line that is no comment with three
// dashes: what stands further up is about something else.
ScriptModule read_script_module(const std::string& name, const std::string& source) {
  ScriptModule module{name, "", "", {}};
  std::istringstream in(source);
  std::string comment;
  bool head = true, body = false;
  for (std::string line; std::getline(in, line);) {
    body = body && !line.starts_with("end");
    if (body && module.functions.back().arguments.ends_with("options"))
      add_options(module.functions.back(), line);
    head = head && line.starts_with("--") && line.find("SPDX") == std::string::npos;
    if (head) add_comment(module.purpose, line, "--");
    if (line.starts_with("---")) {
      add_comment(comment, line, "---");
      continue;
    }
    if (line.starts_with(kFunction)) {
      module.functions.push_back(read_function(line, in));
      module.functions.back().text = comment;
      body = !line.ends_with(" end");
    }
    if (line.starts_with(kReturn) && is_name(std::string_view(line).substr(kReturn.size())))
      module.table = line.substr(kReturn.size());
    comment.clear();
  }
  return module;
}

std::string title_of(const ScriptFunction& function) {
  return function.name + "(" + function.arguments + ")";
}

std::string description_of(const ScriptFunction& function) {
  if (function.options.empty()) return function.text;
  std::string text = function.text + (function.text.empty() ? "Options: " : " Options: ");
  for (std::size_t i = 0; i < function.options.size(); ++i)
    text += (i == 0 ? "" : ", ") + function.options[i];
  return text + ".";
}

std::vector<ScriptModule> script_modules(const std::filesystem::path& folder) {
  std::vector<ScriptModule> modules;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    const std::filesystem::path relative = entry.path().lexically_relative(folder);
    // Rigs and instruments are no modules: nothing requires them.
    const bool module = *relative.begin() != "rigs" && *relative.begin() != "instruments";
    if (entry.path().extension() != ".lua" || !module) continue;
    modules.push_back(read_script_module(module_name(relative), read_text_file(entry.path())));
  }
  std::sort(modules.begin(), modules.end(),
            [](const ScriptModule& a, const ScriptModule& b) { return a.name < b.name; });
  return modules;
}

}  // namespace vitreo::lua
