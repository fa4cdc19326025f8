// SPDX-License-Identifier: Apache-2.0
#include "host/session/operator_desk.h"

#include <fmt/format.h>

#include <map>
#include <stdexcept>

namespace vitreo {
namespace {

// The words that end a run, which are the ones that need neither a right nor control of the page.
const std::map<std::string, StopTier>& ends() {
  static const std::map<std::string, StopTier> kEnds{
      {"stop", StopTier::stop}, {"abort", StopTier::abort}, {"emergency", StopTier::emergency}};
  return kEnds;
}

/// The person for the record: the name, or "operator at" the face that the command came from.
/// Without a name the record says from where the command came.
std::string person(const OperatorCommand& command) {
  return command.by.empty() ? "operator at " + command.source : command.by;
}

/// The words that a person can choose from; empty where any text may do.
std::vector<std::string> choices_of(const Parameter& answer) {
  return answer.kind == ParameterKind::flag ? std::vector<std::string>{"yes", "no"}
                                            : answer.choices;
}

/// Those that are latched, as every face shows them.
nlohmann::json alarms_json(const Alarms& alarms) {
  nlohmann::json list = nlohmann::json::array();
  for (const Alarm& alarm : alarms.shown())
    list.push_back({{"name", alarm.name},
                    {"priority", to_string(alarm.priority)},
                    {"text", alarm.text},
                    {"time", to_seconds(alarm.raised)},
                    {"active", alarm.active},
                    {"times", alarm.times},
                    {"acknowledged_by", alarm.acknowledged_by}});
  return list;
}

}  // namespace

const std::vector<std::string>& OperatorDesk::words() {
  static const std::vector<std::string> kWords{"stop",   "abort", "emergency", "pause", "resume",
                                               "answer", "ack",   "target",    "adjust"};
  return kWords;
}

bool OperatorDesk::ends_run(const std::string& word) { return ends().contains(word); }

void OperatorDesk::perform(const OperatorCommand& command) {
  const std::string& word = command.word;
  if (const auto tier = ends().find(word); tier != ends().end()) return end(tier->second, command);
  if (word == "pause") return control_.request_pause(command.text);
  if (word == "resume") return resume(command);
  // Faces only parse; what a command means, and what it is refused for, is decided here.
  if (word == "answer") return questions_.answer(command.text, person(command));
  if (word == "ack") return acknowledge(command);
  if (word == "target") return targets_.give(command.targets);
  if (word == "adjust") return adjust(command);
  throw std::invalid_argument(
      fmt::format("'{}' is not understood: do one of {}", word, fmt::join(words(), ", ")));
}

/// No right is needed to end a run.
void OperatorDesk::end(StopTier tier, const OperatorCommand& command) {
  std::string reason = "by " + (command.by.empty() ? command.source : command.by);
  // "by NAME: REASON", as the end record has it.
  if (!command.text.empty()) reason += ": " + command.text;
  if (command.source == "the script") return control_.request(tier, reason, {"script"});
  control_.request(tier, reason, {"person", command.by, command.source});
}

void OperatorDesk::resume(const OperatorCommand& command) {
  // The right is checked before anything changes.
  if (command.override_condition) {
    rights_.require_researcher(command.by, "an override");
    control_.override_suspension(person(command));
  }
  control_.resume();
}

void OperatorDesk::acknowledge(const OperatorCommand& command) {
  if (alarms_.acknowledge(command.text, person(command)) == 0)
    throw std::invalid_argument("no alarm stands");
}

void OperatorDesk::offer(HandControls* controls) {
  const std::lock_guard lock(mutex_);
  controls_ = controls;
}

/// A value that is left out moves nothing: the instruments are read, for the face that shows them.
void OperatorDesk::adjust(const OperatorCommand& command) {
  const std::lock_guard lock(mutex_);
  if (controls_ == nullptr)
    throw std::invalid_argument(
        "instruments are adjusted by hand only in a run at the pace of the wall clock");
  if (!command.to) return controls_->read();
  controls_->adjust(command.text, *command.to, person(command));
}

unsigned long OperatorDesk::changes() const noexcept {
  const std::lock_guard lock(mutex_);
  return control_.changes() + alarms_.changes() + (controls_ ? controls_->changes() : 0);
}

nlohmann::json OperatorDesk::status() const {
  const RunStatus status = control_.status();
  nlohmann::json json = {{"phase", to_string(status.phase)},
                         {"tier", to_string(status.tier)},
                         {"waiting_for", status.waiting_for},
                         {"note", status.note},
                         {"text", to_string(status)},
                         {"progress", status.progress},
                         {"doing", status.doing},
                         {"alarms", alarms_json(alarms_)}};
  // Absent while it is not known, rather than a number that means so.
  if (status.remaining >= 0) json["remaining"] = status.remaining;
  if (const auto question = questions_.open())
    json["question"] = {{"number", question->number},
                        {"name", question->answer.name},
                        {"text", shown(*question)},
                        {"choices", choices_of(question->answer)},
                        {"task", question->task}};
  const std::lock_guard lock(mutex_);
  if (controls_ == nullptr) return json;
  if (nlohmann::json instruments = controls_->status(); !instruments.empty())
    json["instruments"] = std::move(instruments);
  return json;
}

}  // namespace vitreo
