// Findings about a machine: what was looked at, what was found, and the commands that mend it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>

#include <cstddef>
#include <string>
#include <vector>

namespace vitreo::machine {

/// unknown: it could not be seen, so nothing is claimed.
enum class State { good, unknown, warning, fault };
/// "good", "unknown", "warning", "fault".
const char* to_string(State state);

struct Finding {
  std::string check;  // what was looked at: "udev_rules"
  State state = State::good;
  std::string found;                // for people, one sentence or two
  std::vector<std::string> mend{};  // lines for a shell, in their order; may be empty
  bool missing = false;             // a fault of its own kind: an instrument is not there
};
using Findings = std::vector<Finding>;

std::size_t count(const Findings& findings, State state);
/// Whether there are faults, and all of them are missing instruments.
bool only_missing(const Findings& findings);

/// [{"check", "state", "found", "mend": [...], "missing"}].
nlohmann::json to_json(const Findings& findings);

/// For people: what is good first, one line each, then what could not be told, warnings, faults,
/// each with its commands, and the counts. Sentences are broken at `columns`, commands never are.
std::string to_text(const Findings& findings, std::size_t columns, bool color);

/// A word for a shell: as it is, or in single quotes.
std::string shell_word(const std::string& text);

}  // namespace vitreo::machine
