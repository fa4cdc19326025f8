// Questions of the interview that makes a rig file, and what it needs to know of the machine.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/rig/asking.h"

#include <nlohmann/json.hpp>

#include <functional>
#include <string>
#include <vector>

namespace vitreo {

/// What the interview needs to know of the machine. Its functions are called during answer().
struct InterviewWorld {
  nlohmann::json plugged_in = nlohmann::json::array();  ///< as find_instruments() gives it
  std::function<AskingPlan(const std::string& address)> plan;
  /// Throws ConfigError for an address that cannot be asked, DeviceError.
  std::function<AskingResult(const std::string& address)> ask;
  /// The file of a rig of that name. Throws ConfigError where there is one already, or for no name.
  std::function<std::string(const std::string& name)> file_for;
  /// The whole file, as it would be written. Throws ConfigError where no rig can be opened by it.
  std::function<void(const std::string& file, const std::string& lua)> check;
  std::string today;                   ///< "2026-11-21"
  std::vector<std::string> folders{};  ///< as RigDescription::folders: of instruments' Lua files
};

struct AnswerOption {
  std::string word;
  std::string text;
};

struct InterviewQuestion {
  std::string key;     ///< "coils.current_limit"; the name of its answer in a file of answers
  std::string before;  ///< shown above it, in lines; may be empty
  std::string text;
  std::string help;
  std::vector<AnswerOption> options{};  ///< answered by word or number; empty: free
  std::string fallback{};               ///< taken for an empty line; empty: there must be an answer
  std::string wanted{};                 ///< "a current, 0.1 to 20 A"; empty: the options tell it
};
/// Lines broken for a terminal of 80 columns.
std::string wrapped(const std::string& text);
/// For people: what stands above the place where the answer is typed.
std::string to_text(const InterviewQuestion& question);

}  // namespace vitreo
