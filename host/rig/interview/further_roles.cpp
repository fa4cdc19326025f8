// Questions of the interview about instruments in Lua: for the fixed roles, and under names of
// their own.
// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/declaration.h"
#include "host/rig/identities.h"
#include "host/rig/interview/steps.h"
#include "host/rig/registry.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>

namespace vitreo {
namespace {

std::vector<InstrumentSummary> summaries(const RigDraft& draft) {
  std::vector<InstrumentSummary> all = instrument_summaries(description_of(draft), draft.file);
  // Drivers in C++ come first where a name is both: the rig file would open that one.
  std::erase_if(all, [](const InstrumentSummary& one) { return is_built_in(one.name); });
  return all;
}

/// Of these a rig can have several, each under a name of its own.
bool can_be_further(const std::string& kind) {
  return scripted::is_free(kind) || kind == "stage" || kind == "rotation_stage" ||
         kind == "field_probe";
}

bool is_taken(const RigDraft& draft, const std::string& name) {
  const std::vector<std::string>& fixed = role_names();
  return draft.find(name) != nullptr || std::find(fixed.begin(), fixed.end(), name) != fixed.end();
}

/// What it measures, or its kind; counted from 2 where that is there already.
std::string usual_name(const RigDraft& draft, const InstrumentSummary& file) {
  std::string word = file.measures.empty() ? file.kind : file.measures;
  // As check_role_name() has it: "pH" becomes "ph".
  for (char& c : word)
    c = std::isalnum(static_cast<unsigned char>(c)) != 0
            ? static_cast<char>(std::tolower(static_cast<unsigned char>(c)))
            : '_';
  std::string name = word;
  for (int i = 2; is_taken(draft, name); ++i) name = word + std::to_string(i);
  return name;
}

void check_role_name(const RigDraft& draft, const std::string& name) {
  constexpr const char* kLetters = "abcdefghijklmnopqrstuvwxyz_0123456789";
  if (name.empty() || name.size() > 40 || name[0] < 'a' || name[0] > 'z' ||
      name.find_first_not_of(kLetters) != std::string::npos)
    throw ConfigError("'" + name + "' is no name: small letters, digits and _, a letter first");
  if (is_taken(draft, name))
    throw ConfigError("'" + name + "' is a role already: choose another name");
}

/// The world is borrowed and outlives the interview; the summary is copied into the step.
InterviewStep role_name_step(const InterviewWorld& world, const InstrumentSummary& file) {
  return [&world, file](const InterviewState& state) -> std::optional<AskedQuestion> {
    AskedQuestion asked;
    asked.question = {
        .key = "further.name",
        .before = "",
        .text = fmt::format("{}: under which name", file.title),
        .help =
            "Scripts call it by that name: rig.bath, rig.stage2. A protocol may need it by this "
            "name, or by its kind.",
        .options = {},
        .fallback = usual_name(state.draft, file),
        .wanted = "small letters, digits and _"};
    asked.accept = [&world, file](InterviewState& at, const std::string& typed) {
      check_role_name(at.draft, typed);
      at.next({address_step(world, typed, file.name)});
      return std::string();
    };
    return asked;
  };
}

}  // namespace

std::optional<InstrumentSummary> file_called(const RigDraft& draft, const std::string& name) {
  if (is_built_in(name)) return std::nullopt;
  for (const InstrumentSummary& one : summaries(draft))
    if (one.name == name) return one;
  return std::nullopt;
}

std::vector<AnswerOption> file_options(const RigDraft& draft, const std::string& role) {
  std::vector<AnswerOption> options;
  for (const InstrumentSummary& one : summaries(draft))
    if (one.kind == role) options.push_back({one.name, one.title + ", in Lua"});
  return options;
}

std::vector<InterviewStep> file_setting_steps(const RigDraft& draft, const std::string& role,
                                              const std::string& driver) {
  const auto file = file_called(draft, driver);
  if (!file) return {};
  std::vector<SettingText> texts;
  for (const auto& [name, help] : file->settings)
    texts.push_back({name, help.empty() ? "setting of " + file->title : help,
                     "Declared by the instrument's file: vitreo docs instrument " + driver + "."});
  return setting_steps(role, texts);
}

InterviewStep further_step(const InterviewWorld& world) {
  return [&world](const InterviewState& state) -> std::optional<AskedQuestion> {
    AskedQuestion asked;
    asked.question = {
        .key = "further",
        .before = "\n",
        .text =
            "Further instruments, in Lua, under names of their own: a heater, a pump, a second "
            "stage. Which?",
        .help =
            "Those that come with the program, and the files beside the rig file or in its folder "
            "instruments/. `vitreo new instrument` begins another one.",
        .options = {{"none", "no further one"}},
        .fallback = "none"};
    const std::vector<InstrumentSummary> all = summaries(state.draft);
    for (const InstrumentSummary& one : all) {
      if (!can_be_further(one.kind)) continue;
      const bool found =
          std::any_of(state.found.begin(), state.found.end(),
                      [&](const FoundInstrument& other) { return other.driver == one.name; });
      const std::string kind = one.measures.empty() ? one.kind : one.kind + ":" + one.measures;
      asked.question.options.push_back(
          {one.name, one.title + " (" + kind + ")" + (found ? ", which has answered" : "")});
    }
    // "none" alone is no choice: the question is left out.
    if (asked.question.options.size() == 1) return std::nullopt;
    asked.accept = [&world, all](InterviewState& at, const std::string& word) {
      if (word == "none") return std::string();
      const auto file = std::find_if(
          all.begin(), all.end(), [&](const InstrumentSummary& one) { return one.name == word; });
      // The same question again behind the name, until the answer is "none".
      at.next({role_name_step(world, *file), further_step(world)});
      return std::string();
    };
    return asked;
  };
}

}  // namespace vitreo
