// Steps of the interview that makes a rig file: each becomes a question when its turn comes.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/rig/instrument_file.h"
#include "host/rig/interview/question.h"
#include "host/rig/interview/rig_draft.h"
#include "host/rig/interview/setting_texts.h"

#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace vitreo {

struct InterviewState;

/// A question, and what its answer does. `accept` gets the word of an option, or the text as typed
/// or by default; it throws ConfigError for what cannot be, and returns what is to be told.
struct AskedQuestion {
  InterviewQuestion question;
  std::function<std::string(InterviewState& state, const std::string& typed)> accept;
};
/// Made when its turn comes, of all answers so far; nothing where there is nothing to ask.
using InterviewStep = std::function<std::optional<AskedQuestion>(const InterviewState& state)>;

/// All that is known so far. A copy is the way back.
struct InterviewState {
  RigDraft draft;
  std::deque<InterviewStep> agenda;
  std::vector<FoundInstrument> found;
  std::map<std::string, std::string> proposed;  ///< by key: what an instrument has told, as typed
  bool asked_all = false;                       ///< no further port is to be asked
  bool done = false;
  void next(const std::vector<InterviewStep>& steps) {
    agenda.insert(agenda.begin(), steps.begin(), steps.end());
  }
};

/// The rig's name and title.
InterviewStep name_step(const InterviewWorld& world);
InterviewStep title_step();
/// What is plugged in, and the offers to ask it.
std::vector<InterviewStep> port_steps(const InterviewWorld& world);
/// Which instrument plays a role, and its settings.
InterviewStep role_step(const InterviewWorld& world, const RoleText& role);
/// The address of a role's driver, and then its settings.
InterviewStep address_step(const InterviewWorld& world, const std::string& role,
                           const std::string& driver);
/// Roles under names of their own, for instruments in Lua, until there is no further one.
InterviewStep further_step(const InterviewWorld& world);
/// Lua files that can play a fixed role, as its options; and what one is, nothing for another name.
std::vector<AnswerOption> file_options(const RigDraft& draft, const std::string& role);
std::optional<InstrumentSummary> file_called(const RigDraft& draft, const std::string& name);
/// The settings that the role's Lua file declares; none of a built-in driver.
std::vector<InterviewStep> file_setting_steps(const RigDraft& draft, const std::string& role,
                                              const std::string& driver);
InterviewStep sample_step();
/// The settings of a table that stands in the draft; `below`: "z." for those of an inner table.
std::vector<InterviewStep> setting_steps(const std::string& table,
                                         const std::vector<SettingText>& texts,
                                         const std::string& below = "");
/// The day of a field that was measured, where one is given.
InterviewStep calibration_step(const InterviewWorld& world);
InterviewStep write_step(const InterviewWorld& world);

/// Stand-ins are taken for what is still to be asked. Throws ConfigError, without the file's name,
/// where the rig as it stands could not be opened.
void check_draft(const RigDraft& draft);

}  // namespace vitreo
