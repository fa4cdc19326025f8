// `vitreo completion`: scripts for bash, zsh and fish. They ask the program itself (`vitreo
// complete`), so that they know every command, protocol, parameter and run, and cannot grow old.
// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/declaration.h"
#include "host/cli/command_line.h"
#include "host/cli/new_instrument.h"
#include "host/cli/program.h"
#include "host/rig/instrument_file.h"
#include "host/rig/registry.h"
#include "host/runs/export.h"
#include "host/runs/run_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <set>

namespace vitreo::cli {
namespace {

constexpr const char* kBash =
    R"(# vitreo's completion for bash: source it, or put it, under the name vitreo,
# into /usr/share/bash-completion/completions
_vitreo() {
  local IFS=$'\n'
  local word="${COMP_LINE:0:COMP_POINT}"
  word="${word##*[[:space:]]}"
  COMPREPLY=($(vitreo complete -- "${COMP_WORDS[@]:1:COMP_CWORD-1}" "$word" 2>/dev/null))
  # bash takes = and : for the ends of words: what stands before them is there already
  local before="${word%"${word##*[=:]}"}"
  COMPREPLY=("${COMPREPLY[@]#"$before"}")
  [[ ${#COMPREPLY[@]} == 1 && ${COMPREPLY[0]} == *= ]] && compopt -o nospace
  [[ ${#COMPREPLY[@]} == 0 ]] && compopt -o default
}
complete -F _vitreo vitreo
)";

constexpr const char* kZsh = R"(#compdef vitreo
# vitreo's completion for zsh: put it as _vitreo into a folder of $fpath
_vitreo() {
  local -a found
  found=("${(@f)$(vitreo complete -- "${(@)words[2,CURRENT-1]}" "$words[CURRENT]" 2>/dev/null)}")
  if [[ -n "$found[1]" ]]; then
    compadd -S '' -- ${(M)found:#*=}
    compadd -- ${found:#*=}
  else
    _files
  fi
}
# Loaded by its name it is called at once; sourced it is only made known.
if [[ "$funcstack[1]" == _vitreo ]]; then _vitreo "$@"; else compdef _vitreo vitreo; fi
)";

constexpr const char* kFish =
    R"(# vitreo's completion for fish: put it into ~/.config/fish/completions/vitreo.fish
function __vitreo_complete
  set -l found (vitreo complete -- (commandline -opc)[2..-1] (commandline -ct) 2>/dev/null)
  if test (count $found) -gt 0
    printf '%s\n' $found
  else
    __fish_complete_path (commandline -ct)
  end
end
complete -c vitreo -f -a '(__vitreo_complete)'
)";

using Words = std::vector<std::string>;

// "protocols/servo_square.lua" is typed as "servo_square".
Words stems(const Words& files) {
  Words names;
  for (const std::string& file : files)
    names.push_back(std::filesystem::path(file).stem().string());
  return names;
}

/// "hold=" for the parameters that were not given; after "mode=" the values that there are.
/// The protocol is loaded for this, so a file with an error throws, and the shell, which drops the
/// standard error, offers nothing.
Words parameter_words(Program& program, const Words& before, const std::string& protocol,
                      const std::string& word) {
  Words found;
  const ProtocolDescription described = program.engine().describe(Program::protocol_file(protocol));
  for (const Parameter& parameter : described.parameters) {
    const std::string head = parameter.name + "=";
    const bool given = std::any_of(before.begin(), before.end(),
                                   [&](const auto& one) { return one.starts_with(head); });
    if (!given) found.push_back(head);
    // The word is in this parameter's value: only its values are of use, and for a number or a text
    // there are none to offer.
    if (!word.starts_with(head)) continue;
    found = {};
    for (const std::string& choice : parameter.choices) found.push_back(head + choice);
    if (parameter.kind == ParameterKind::flag) found = {head + "true", head + "false"};
    return found;
  }
  return found;
}

Words instrument_names() {
  RigDescription none;
  none.folders = {Program::in_data_folder("scripts")};
  return instrument_file_names(none);
}

// Only of the usual folder: --runs may come after the word that is being completed. "last" is a
// run's name to every command that takes one.
Words run_words() {
  Words found{"last"};
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator("runs", error))
    if (entry.is_directory(error)) found.push_back(entry.path().filename().string());
  return found;
}

/// Whether the word after this option is its value.
bool takes_value(const Described& command, const std::string& option) {
  return std::any_of(command.words.begin(), command.words.end(), [&](const Described::Word& word) {
    return word.takes_value && !word.positional &&
           std::find(word.names.begin(), word.names.end(), option) != word.names.end();
  });
}

/// Those that are neither options nor their values.
/// Positional words are counted by their place, so an option's value must not be taken for one.
Words bare_words(const Described& command, const Words& before) {
  Words bare;
  for (std::size_t i = 0; i < before.size(); ++i)
    if (!before[i].starts_with("-"))
      bare.push_back(before[i]);
    else if (takes_value(command, before[i]))
      ++i;
  return bare;
}

Words value_words(const std::string& command, const std::string& option) {
  if (option == "--rig") return stems(Program::rig_files());
  if (option == "--link") return instrument_links();
  if (option == "--outcome")
    return {"completed", "failed", "stopped", "aborted", "lost", "running", "unreadable"};
  if (option == "--as") {
    Words names;
    for (const ExportFormat& format : export_formats()) names.push_back(format.name);
    return names;
  }
  if (option == "--role" && command == "new") return scripted::kinds();
  if (option == "--role" || option == "--test") return role_names();
  return {};  // the shell's files
}

// The word's meaning by its place in the command. What is not listed here completes to nothing, and
// then the shell offers its files.
Words positional_words(Program& program, const std::string& command, const Words& bare,
                       const std::string& word) {
  static const std::set<std::string> kOfProtocols{"run",  "describe", "check", "test",
                                                  "soak", "sweep",    "view"};
  static const std::set<std::string> kOfRuns{"show",   "verify", "recover",
                                             "report", "export", "replay"};
  if (kOfProtocols.contains(command) && bare.empty()) return stems(Program::protocol_files());
  if (kOfProtocols.contains(command) && command != "describe")
    return parameter_words(program, bare, bare.front(), word);
  if (command == "new" && bare.size() == 2 && bare.front() == "driver")
    return {"stage", "coils", "field_probe"};
  if (command == "new" && bare.size() == 2 && bare.front() == "instrument")
    return scripted::kinds();
  if (command == "docs" && bare.size() == 1 && bare.front() == "instrument")
    return instrument_names();
  if (command == "compare") return run_words();
  if (!bare.empty()) return {};
  if (command == "control")
    return {"status", "pause", "resume", "stop", "abort", "emergency", "answer", "ack", "adjust"};
  if (command == "completion") return {"bash", "zsh", "fish"};
  if (command == "new") return {"protocol", "instrument", "rig", "driver"};
  if (command == "docs") return page_names();
  if (command == "emulate") return stems(Program::rig_files());
  return kOfRuns.contains(command) ? run_words() : Words{};
}

/// Candidates for the last of `words`: commands, option names, values, positional words.
/// The order decides: a value belongs to the option before it, whatever it looks like; option names
/// are offered as soon as a dash stands there; what does not begin as the word does is dropped
/// last, for all kinds at once. Shells filter too, but by rules of their own.
Words complete(const CommandLine& line, Program& program, Words words) {
  if (words.empty()) words.emplace_back();
  const std::string word = words.back();
  words.pop_back();
  const auto commands = line.describe();  // the first is the program without a command
  auto here = commands.begin();
  for (auto it = commands.begin() + 1; it != commands.end(); ++it)
    // Only the first word can be the command: behind an option of the program itself no command is
    // known.
    if (!words.empty() && it->name == words.front()) here = it;
  Words found;
  if (here == commands.begin()) {
    for (auto it = commands.begin() + 1; it != commands.end() && words.empty(); ++it)
      found.push_back(it->name);
  } else {
    words.erase(words.begin());
    const bool value = !words.empty() && takes_value(*here, words.back());
    found = value ? value_words(here->name, words.back())
                  : positional_words(program, here->name, bare_words(*here, words), word);
  }
  if (word.starts_with("-"))
    for (const Described::Word& option : here->words)
      if (!option.positional) found.insert(found.end(), option.names.begin(), option.names.end());
  std::erase_if(found, [&](const std::string& one) { return !one.starts_with(word); });
  return found;
}

}  // namespace

void add_completion(CommandLine& line, Program& program) {
  const auto shell = std::make_shared<std::string>();
  Command command =
      line.command("completion", "prints the completion for a shell: bash, zsh or fish", [shell] {
        const std::string& name = *shell;
        if (name != "bash" && name != "zsh" && name != "fish")
          throw ConfigError("there is completion for bash, zsh and fish, not for '" + name + "'");
        fmt::print("{}", name == "bash" ? kBash : name == "zsh" ? kZsh : kFish);
        return 0;
      });
  command.option("shell", *shell, "bash, zsh or fish").required();
  command.examples({"vitreo completion bash > ~/.local/share/bash-completion/completions/vitreo"});

  const auto words = std::make_shared<std::vector<std::string>>();
  Command asked =
      line.command("complete", "what the last of these words may become, for the shells",
                   [&line, &program, words] {
                     for (const std::string& one : complete(line, program, *words))
                       fmt::print("{}\n", one);
                     return 0;
                   });
  asked.option("words", *words, "after --: all words so far");
  asked.hidden();
}

}  // namespace vitreo::cli
