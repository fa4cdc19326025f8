// SPDX-License-Identifier: Apache-2.0
#include "host/rig/interview/rig_interview.h"

#include "host/rig/interview/steps.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <utility>

namespace vitreo {
namespace {

constexpr const char* kEndings = "back: the question before; ?: more about it; quit: leave";

std::string typed_line(const std::string& line) {
  const std::size_t begin = line.find_first_not_of(" \t\r");
  if (begin == std::string::npos) return "";
  return line.substr(begin, line.find_last_not_of(" \t\r") - begin + 1);
}

/// The word of an option by itself or its number. Throws ConfigError.
std::string chosen(const InterviewQuestion& question, const std::string& typed) {
  if (question.options.empty()) return typed;
  std::vector<std::string> words;
  for (const AnswerOption& option : question.options) words.push_back(option.word);
  if (std::find(words.begin(), words.end(), typed) != words.end()) return typed;
  const bool digits = typed.find_first_not_of("0123456789") == std::string::npos;
  if (digits && typed.size() < 4) {
    const std::size_t number = std::stoul(typed);
    if (number >= 1 && number <= words.size()) return words[number - 1];
    throw ConfigError(fmt::format("there is no {}: 1 to {}", typed, words.size()));
  }
  std::vector<std::string> same;
  std::copy_if(words.begin(), words.end(), std::back_inserter(same),
               [&](const std::string& word) { return word.starts_with(typed); });
  if (same.size() == 1) return same.front();
  const std::string near = nearest(typed, words);
  throw ConfigError("'" + typed + "' is none of them" +
                    (near.empty() ? "" : "; did you mean " + near + "?"));
}

std::string explanation(const InterviewQuestion& question) {
  std::string text = question.help.empty() ? question.text : question.help;
  if (!question.wanted.empty()) text += "\nIt wants " + question.wanted + ".";
  return text + fmt::format("\n({})", kEndings);
}

/// Answers that are offered again after a way back; a question that sends bytes is none of them,
/// nor one that is asked again for the next instrument.
bool is_remembered(const std::string& key) {
  return !key.starts_with("ask ") && key != "another" && !key.starts_with("further") &&
         key != "write";
}

}  // namespace

struct RigInterview::Inner {
  InterviewWorld world;
  InterviewState state;
  std::vector<InterviewState> before;  // of each answered question, that one still to be asked
  std::optional<AskedQuestion> asked;
  std::map<std::string, std::string> given;  // by key
  bool left = false;

  explicit Inner(InterviewWorld knows) : world(std::move(knows)) {}

  void begin(const std::string& name) {
    state.draft.today = world.today;
    state.draft.folders = world.folders;
    for (const InterviewStep& step : port_steps(world)) state.agenda.push_back(step);
    state.agenda.push_back([this](const InterviewState& now) { return model_step(now); });
    for (const RoleText& role : role_texts()) state.agenda.push_back(role_step(world, role));
    state.agenda.push_back(further_step(world));
    state.agenda.push_back(sample_step());
    state.agenda.push_back(calibration_step(world));
    state.agenda.push_back(write_step(world));
    state.next({title_step()});
    if (name.empty())
      state.next({name_step(world)});
    else
      state.draft.file = world.file_for(name);
    advance();
  }

  /// The model's settings are there in every rig.
  std::optional<AskedQuestion> model_step(const InterviewState& now) const {
    InterviewState after = now;
    after.draft.table("model").comments = {"What the loop believes of eye, robot and coils."};
    const auto steps = setting_steps("model", setting_texts("model", ""));
    auto first = steps.front()(after);
    first->question.before = "\nThe model\n";
    first->accept = [accept = first->accept, steps](InterviewState& at, const std::string& typed) {
      at.draft.table("model").comments = {"What the loop believes of eye, robot and coils."};
      const std::string told = accept(at, typed);
      at.next({steps.begin() + 1, steps.end()});
      return told;
    };
    return first;
  }

  /// To the next question. The state keeps it at the head of its agenda until it is answered.
  void advance() {
    asked.reset();
    while (!state.done && !state.agenda.empty()) {
      asked = state.agenda.front()(state);
      if (asked) break;
      state.agenda.pop_front();
    }
    if (!asked) return;
    const auto known = given.find(asked->question.key);
    if (known != given.end()) asked->question.fallback = known->second;
  }

  InterviewReply accept(const std::string& typed) {
    const InterviewQuestion question = asked->question;
    const InterviewState as_before = state;
    try {
      const std::string word = typed.empty() ? question.fallback : chosen(question, typed);
      if (word.empty()) return {InterviewReply::Kind::refused, "an answer is needed; ? tells more"};
      state.agenda.pop_front();
      const std::string told = asked->accept(state, word);
      if (is_remembered(question.key)) given[question.key] = word;
      before.push_back(as_before);
      advance();
      return {InterviewReply::Kind::accepted, told};
    } catch (const ConfigError& problem) {
      state = as_before;
      return {InterviewReply::Kind::refused, problem.what()};
    }
  }

  InterviewReply back() {
    if (before.empty()) return {InterviewReply::Kind::refused, "this is the first question"};
    state = before.back();
    before.pop_back();
    advance();
    return {InterviewReply::Kind::back, ""};
  }
};

RigInterview::RigInterview(InterviewWorld world, const std::string& name)
    : inner_(std::make_unique<Inner>(std::move(world))) {
  inner_->begin(name);
}
RigInterview::~RigInterview() = default;

bool RigInterview::done() const { return inner_->state.done; }
bool RigInterview::left() const { return inner_->left; }
const InterviewQuestion& RigInterview::question() const { return inner_->asked.value().question; }
const RigDraft& RigInterview::draft() const { return inner_->state.draft; }

InterviewReply RigInterview::answer(const std::string& line) {
  const std::string typed = typed_line(line);
  if (typed == "quit") {
    inner_->left = true;
    return {InterviewReply::Kind::quit, "nothing is written"};
  }
  if (typed == "back") return inner_->back();
  if (typed == "?") return {InterviewReply::Kind::explained, explanation(question())};
  return inner_->accept(typed);
}

}  // namespace vitreo
