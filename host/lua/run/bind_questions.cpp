// Bindings of run: questions to the operator, and reminders.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/binding.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/people.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/run/classes.h"
#include "host/text/units.h"

#include <algorithm>
#include <stdexcept>

namespace vitreo::lua {
namespace {

int push_answer(Call& call, const Parameter& parameter, const ArgumentValue& value) {
  if (const bool* flag = std::get_if<bool>(&value)) {
    lua_pushboolean(call.L, *flag);
    return 1;
  }
  if (const double* number = std::get_if<double>(&value)) {
    if (parameter.kind != ParameterKind::integer) return call.result(*number);
    lua_pushinteger(call.L, static_cast<lua_Integer>(*number));
    return 1;
  }
  return call.result(std::get<std::string>(value));
}

constexpr double kQuestionLimit = 3600;  // s of wall time, unless the script says another

int put_question(Call& call, const Question& question) {
  return ask_people(call, question, call.number_option("timeout").value_or(kQuestionLimit),
                    [parameter = question.answer](Call& done, const ArgumentValue& value) {
                      return push_answer(done, parameter, value);
                    });
}

std::string question_name(const Call& call) { return call.text_option("name").value_or("answer"); }

int confirm(Call& call) {
  Question question;
  question.text = call.text(0);
  question.answer.name = question_name(call);
  question.answer.kind = ParameterKind::flag;
  question.answer.fallback = false;
  return put_question(call, question);
}

std::vector<std::string> choices_of(const Call& call) {
  std::vector<std::string> choices;
  if (call.push_option("choices")) {
    const auto count = static_cast<lua_Integer>(lua_rawlen(call.L, -1));
    for (lua_Integer i = 1; i <= count; ++i) {
      lua_rawgeti(call.L, -1, i);
      choices.push_back(plain_text(call.L, -1));
      lua_pop(call.L, 1);
    }
    if (choices.empty()) throw std::invalid_argument("choices: the list is empty");
  }
  lua_pop(call.L, 1);
  return choices;
}

/// A number, unless choices or a type say something else.
ParameterKind kind_of_question(const Call& call, bool has_choices) {
  const std::string type = call.text_option("type").value_or(has_choices ? "choice" : "number");
  const std::pair<const char*, ParameterKind> kinds[] = {{"number", ParameterKind::number},
                                                         {"integer", ParameterKind::integer},
                                                         {"choice", ParameterKind::choice},
                                                         {"text", ParameterKind::text}};
  for (const auto& [name, kind] : kinds)
    if (type == name) return kind;
  throw std::invalid_argument("type: wants number, integer, choice or text, got " + type);
}

void read_default(const Call& call, Question& question) {
  const bool number = question.answer.kind == ParameterKind::number ||
                      question.answer.kind == ParameterKind::integer;
  question.has_default = call.push_option("default");
  const int wanted = number ? LUA_TNUMBER : LUA_TSTRING;
  if (question.has_default && lua_type(call.L, -1) != wanted)
    throw std::invalid_argument(std::string("default: wants a ") + lua_typename(call.L, wanted) +
                                ", got " + kind_of(call.L, -1));
  if (number)
    question.answer.fallback = lua_tonumber(call.L, -1);
  else
    question.answer.fallback = question.has_default ? plain_text(call.L, -1) : std::string();
  lua_pop(call.L, 1);
}

/// What is said of an answer that it cannot have.
void check_fitting(const Call& call, ParameterKind kind) {
  const bool number = kind == ParameterKind::number || kind == ParameterKind::integer;
  for (const char* name : {"unit", "min", "max", "choices"}) {
    const bool fits = std::string(name) == "choices" ? kind == ParameterKind::choice : number;
    const bool given = call.push_option(name);
    lua_pop(call.L, 1);
    if (given && !fits)
      throw std::invalid_argument(std::string(name) + ": is not for answers of this type");
  }
}

/// A question is checked like a protocol's parameter, and its answer read like an argument of the
/// command line. Without a default the fallback is a value within the bounds: the dry run goes on
/// with it.
int ask(Call& call) {
  Question question;
  question.text = call.text(0);
  Parameter& answer = question.answer;
  answer.name = question_name(call);
  answer.choices = choices_of(call);
  answer.kind = kind_of_question(call, !answer.choices.empty());
  if (answer.kind == ParameterKind::choice && answer.choices.empty())
    throw std::invalid_argument("choices: wants the list to choose from");
  check_fitting(call, answer.kind);
  answer.unit = call.text_option("unit").value_or("");
  if (!find_unit(answer.unit) && !answer.unit.empty())
    throw std::invalid_argument("unit: " + answer.unit + " is not a unit");
  answer.min = call.number_option("min").value_or(answer.min);
  answer.max = call.number_option("max").value_or(answer.max);
  read_default(call, question);
  check(question);
  const bool number = answer.kind == ParameterKind::number || answer.kind == ParameterKind::integer;
  const bool whole = answer.kind == ParameterKind::integer;
  if (number && !question.has_default)
    answer.fallback = std::clamp(1.0, whole ? std::ceil(answer.min) : answer.min,
                                 whole ? std::floor(answer.max) : answer.max);
  return put_question(call, question);
}

/// Dies, and ends, with its handle or with the run.
struct Reminder {
  std::unique_ptr<Task> task;
};

/// A task of the clock of its own. The list of closers has it weakly: a handle that was closed, or
/// collected, ends the reminder before the run ends.
int remind(Call& call) {
  Session& session = session_of(call.L);
  const Time every = from_seconds(call.number_option("every").value_or(300));
  auto reminder = std::make_shared<Reminder>();
  reminder->task = session.clock.spawn("reminder", [&session, every, text = call.text(0)] {
    while (true) {
      session.clock.sleep_for(every);
      session.recorder.event(session.clock.now(), "reminder", text);
      session.listener.message("reminder: " + text);
    }
  });
  call.context().closers.emplace_back([held = std::weak_ptr<Reminder>(reminder)] {
    if (const auto alive = held.lock()) alive->task.reset();
  });
  push_handle(call.L, reminder_class(), std::move(reminder));
  return 1;
}

int close_reminder(Call& call) {
  if (call.self_pointer()) call.self<Reminder>().task.reset();
  close_handle(call);
  return 0;
}

}  // namespace

std::vector<Binding> run_question_rows() {
  const Argument name{.name = "name",
                      .type = Type::text,
                      .optional = true,
                      .help = "for an answer given in advance"};
  const Argument limit{.name = "timeout",
                       .type = Type::number,
                       .unit = "s",
                       .optional = true,
                       .min = 0,
                       .max = 1e6,
                       .help = "of wall time, then it is an error (1 h)"};
  return {{"confirm",
           {{.name = "text", .type = Type::text},
            {.name = "options", .type = Type::options, .optional = true, .options = {name, limit}}},
           "true or false",
           "asks the operator a question of yes or no",
           confirm,
           "run:confirm(\"Is the lamp on?\", { name = \"lamp\" })"},
          {"ask",
           {{.name = "text", .type = Type::text},
            {.name = "options",
             .type = Type::options,
             .optional = true,
             .options = {name,
                         limit,
                         {.name = "type",
                          .type = Type::text,
                          .optional = true,
                          .help = "of the answer (number)",
                          .choices = {"number", "integer", "choice", "text"}},
                         {.name = "unit", .type = Type::text, .optional = true},
                         {.name = "min", .type = Type::number, .optional = true},
                         {.name = "max", .type = Type::number, .optional = true},
                         {.name = "choices", .type = Type::list, .optional = true},
                         {.name = "default", .type = Type::any, .optional = true}}}},
           "the answer; numbers in SI",
           "asks the operator for a value",
           ask,
           "run:ask(\"Depth of the chamber?\", { name = \"depth\", unit = \"mm\", min = 0 })"},
          {"remind",
           {{.name = "text", .type = Type::text},
            {.name = "options",
             .type = Type::options,
             .optional = true,
             .options = {{.name = "every",
                          .type = Type::number,
                          .unit = "s",
                          .optional = true,
                          .min = 1,
                          .max = 1e5}}}},
           "reminder",
           "reminds the operator again and again (default: every 5 minutes) until it is closed or "
           "the run ends",
           remind,
           "run:remind(\"wet the eye\", { every = 300 * s })"}};
}

const Class& reminder_class() {
  static const Class kind{"reminder",
                          "a reminder that comes back",
                          {{.name = "close",
                            .doc = "ends it",
                            .function = close_reminder,
                            .example = "reminder:close()",
                            .when_closed = true}},
                          {}};
  return kind;
}

}  // namespace vitreo::lua
