// SPDX-License-Identifier: Apache-2.0
#include "host/rig/machine/finding.h"

#include "host/text/terminal_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <sstream>

namespace vitreo::machine {
namespace {

constexpr std::size_t kStateColumn = 9;
constexpr std::size_t kNameColumn = 16;

/// Broken between words; a word that is longer than a line stands alone.
std::vector<std::string> lines_of(const std::string& text, std::size_t columns) {
  std::vector<std::string> lines(1);
  std::istringstream words(text);
  for (std::string word; words >> word;) {
    std::string& line = lines.back();
    if (line.empty())
      line = word;
    else if (columns_of(line) + 1 + columns_of(word) <= columns)
      line += " " + word;
    else
      lines.push_back(word);
  }
  return lines;
}

/// The state's word, padded; faults in capitals, so that they are found without colors, too.
std::string state_text(State state, bool color) {
  const std::string word = state == State::fault ? "FAULT" : to_string(state);
  const std::string padding(kStateColumn - word.size(), ' ');
  if (!color) return word + padding;
  // SGR parameters (ECMA-48): green, default, yellow, red.
  const int sgr = state == State::good      ? 32
                  : state == State::unknown ? 39
                  : state == State::warning ? 33
                                            : 31;
  return fmt::format("\x1b[{}m{}\x1b[0m{}", sgr, word, padding);
}

/// "udev rules"; names as their owners write them.
std::string title(const std::string& check) {
  if (check == "modem_manager") return "ModemManager";
  std::string name = check;
  std::replace(name.begin(), name.end(), '_', ' ');
  for (const char* const word : {"usb", "cpu"})
    if (name.starts_with(word))
      std::transform(name.begin(), name.begin() + 3, name.begin(),
                     [](char c) { return static_cast<char>(c - 'a' + 'A'); });
  return name;
}

/// Good findings that say the same are one line: what is fine takes little room.
Findings merged(const Findings& findings) {
  Findings found;
  for (Finding one : findings) {
    one.check = title(one.check);
    const auto same = std::find_if(found.begin(), found.end(), [&one](const Finding& other) {
      return one.state == State::good && other.state == State::good && other.found == one.found;
    });
    if (same == found.end())
      found.push_back(one);
    else
      same->check += ", " + one.check;
  }
  return found;
}

std::string text_of(const Finding& finding, std::size_t columns, bool color) {
  const bool wide = finding.check.size() >= kNameColumn;  // several checks in one
  const std::size_t margin = kStateColumn + (wide ? 0 : kNameColumn);
  const auto lines = lines_of(harmless((wide ? finding.check + ": " : "") + finding.found),
                              columns > margin + 20 ? columns - margin : 20);
  std::string text = state_text(finding.state, color);
  if (!wide) text += fmt::format("{:<{}}", finding.check, kNameColumn);
  text += lines[0] + "\n";
  for (std::size_t i = 1; i < lines.size(); ++i) text += std::string(margin, ' ') + lines[i] + "\n";
  return text;
}

/// The commands; where an earlier finding has the same, its name.
std::string mend_text(const Finding& finding,
                      std::map<std::vector<std::string>, std::string>& printed) {
  if (finding.mend.empty()) return "";
  const std::string margin(kStateColumn, ' ');
  const auto [before, first] = printed.try_emplace(finding.mend, finding.check);
  if (!first) return margin + "# the commands of " + before->second + ", above\n";
  std::string text;
  for (const std::string& command : finding.mend) text += margin + harmless(command) + "\n";
  return text;
}

std::string counted(std::size_t number, const char* one, const char* many) {
  return fmt::format("{} {}", number, number == 1 ? one : many);
}

}  // namespace

const char* to_string(State state) {
  switch (state) {
    case State::good:
      return "good";
    case State::unknown:
      return "unknown";
    case State::warning:
      return "warning";
    case State::fault:
      return "fault";
  }
  return "";
}

std::size_t count(const Findings& findings, State state) {
  return static_cast<std::size_t>(
      std::count_if(findings.begin(), findings.end(),
                    [state](const Finding& finding) { return finding.state == state; }));
}

bool only_missing(const Findings& findings) {
  return count(findings, State::fault) > 0 &&
         std::all_of(findings.begin(), findings.end(), [](const Finding& finding) {
           return finding.state != State::fault || finding.missing;
         });
}

nlohmann::json to_json(const Findings& findings) {
  nlohmann::json rows = nlohmann::json::array();
  for (const Finding& finding : findings)
    rows.push_back({{"check", finding.check},
                    {"state", to_string(finding.state)},
                    {"found", finding.found},
                    {"mend", finding.mend},
                    {"missing", finding.missing}});
  return rows;
}

// The worst stands last: nearest to the prompt at which the reader goes on.
std::string to_text(const Findings& findings, std::size_t columns, bool color) {
  std::string text;
  const Findings shown = merged(findings);
  std::map<std::vector<std::string>, std::string> printed;
  for (const State state : {State::good, State::unknown, State::warning, State::fault}) {
    if (count(shown, state) > 0 && !text.empty()) text += "\n";
    for (const Finding& finding : shown)
      if (finding.state == state)
        text += text_of(finding, columns, color) + mend_text(finding, printed);
  }
  return text + fmt::format("\n{}, {}, {} unknown, {} good\n",
                            counted(count(findings, State::fault), "fault", "faults"),
                            counted(count(findings, State::warning), "warning", "warnings"),
                            count(findings, State::unknown), count(findings, State::good));
}

// A single quote within is closed, escaped and opened again (POSIX shell, 2.2.2).
std::string shell_word(const std::string& text) {
  const bool plain = !text.empty() && text.find_first_not_of(
                                          "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
                                          "0123456789_-+./:=,@%") == std::string::npos;
  if (plain) return text;
  std::string quoted = "'";
  for (const char c : text) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

}  // namespace vitreo::machine
