// SPDX-License-Identifier: Apache-2.0
#include "host/session/questions.h"

#include "host/config/config.h"
#include "host/text/units.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <stdexcept>

namespace vitreo {
namespace {

/// The form of the answer, for the question's parentheses: "yes or no", "a length, at least 1 mm".
std::string wanted(const Parameter& answer) {
  if (answer.kind == ParameterKind::flag) return "yes or no";
  if (answer.kind == ParameterKind::choice) {
    std::string text;
    for (const std::string& choice : answer.choices) text += (text.empty() ? "" : ", ") + choice;
    return text;
  }
  if (answer.kind == ParameterKind::text) return "";
  const auto unit = find_unit(answer.unit);
  const std::string dimension(unit ? unit->dimension : "");
  std::string text =
      answer.kind == ParameterKind::integer ? "a whole number" : quantity_name(dimension);
  if (std::isfinite(answer.min)) text += ", at least " + format_quantity(answer.min, dimension);
  if (std::isfinite(answer.max)) text += ", at most " + format_quantity(answer.max, dimension);
  return text;
}

/// The default as the operator would type it.
/// In the display unit with its symbol, which read_answer() takes back as it stands.
std::string default_text(const Parameter& answer) {
  if (const bool* flag = std::get_if<bool>(&answer.fallback)) return *flag ? "yes" : "no";
  if (const double* number = std::get_if<double>(&answer.fallback)) {
    const auto unit = find_unit(answer.unit);
    return format_quantity(*number, unit ? std::string(unit->dimension) : "");
  }
  return std::get<std::string>(answer.fallback);
}

std::string trimmed(const std::string& text) {
  const std::size_t from = text.find_first_not_of(" \t\r\n");
  const std::size_t to = text.find_last_not_of(" \t\r\n");
  return from == std::string::npos ? "" : text.substr(from, to - from + 1);
}

/// yes, y, true or on; no, n, false or off; in any case. Throws ConfigError.
ArgumentValue yes_or_no(const Parameter& answer, std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  for (const char* yes : {"yes", "y", "true", "on"})
    if (text == yes) return true;
  for (const char* no : {"no", "n", "false", "off"})
    if (text == no) return false;
  throw ConfigError(answer.name + ": wants yes or no; got '" + text + "'");
}

/// The answer as a value in SI; what does not fit throws ConfigError saying what is wanted.
ArgumentValue read_answer(const Parameter& answer, const std::string& text) {
  return answer.kind == ParameterKind::flag ? yes_or_no(answer, text) : read_argument(answer, text);
}

}  // namespace

/// Flags and texts have no wrong default.
void check(const Question& question) {
  const Parameter& answer = question.answer;
  if (answer.kind == ParameterKind::choice && question.has_default &&
      std::find(answer.choices.begin(), answer.choices.end(),
                std::get<std::string>(answer.fallback)) == answer.choices.end())
    throw std::invalid_argument("default: '" + std::get<std::string>(answer.fallback) +
                                "' is not among the choices");
  const bool integer = answer.kind == ParameterKind::integer;
  if (!integer && answer.kind != ParameterKind::number) return;
  const auto unit = find_unit(answer.unit);
  const std::string dimension(unit ? unit->dimension : "");
  const std::string min = format_quantity(answer.min, dimension);
  const std::string max = format_quantity(answer.max, dimension);
  if (answer.min > answer.max) throw std::invalid_argument("min: " + min + " is above max, " + max);
  // Such as 1.2 to 1.8.
  if (integer && std::ceil(answer.min) > std::floor(answer.max))
    throw std::invalid_argument("min: there is no whole number from " + min + " to " + max);
  if (!question.has_default) return;
  const double value = std::get<double>(answer.fallback);
  if (value < answer.min || value > answer.max)
    throw std::invalid_argument("default: " + format_quantity(value, dimension) + " is not from " +
                                min + " to " + max);
  if (integer && value != std::floor(value))
    throw std::invalid_argument("default: wants a whole number");
}

std::string shown(const Question& question) {
  const std::string want = wanted(question.answer);
  std::string text = question.text + (want.empty() ? "" : " (" + want + ")");
  const std::string assumed = question.has_default ? default_text(question.answer) : "";
  if (!assumed.empty()) text += " [" + assumed + "]";
  return text;
}

void Questions::prepare(const std::vector<std::string>& answers) {
  const std::lock_guard lock(mutex_);
  for (const std::string& answer : answers) {
    const std::size_t equals = answer.find('=');
    // "=5" has no name: it is an answer by order.
    if (equals == std::string::npos || equals == 0)
      in_order_.push_back(answer);
    else
      by_name_.push_back({answer.substr(0, equals), answer.substr(equals + 1)});
  }
}

// An answer by name wins over one by order and is kept for the next time; answers by order are used
// up, so that a loop of questions gets one after the other.
int Questions::ask(Question question) {
  std::string prepared;
  bool is_prepared = false;
  {
    const std::lock_guard lock(mutex_);
    question.number = ++asked_;
    answer_.reset();
    names_.push_back(question.answer.name);
    const auto named = std::find_if(by_name_.begin(), by_name_.end(), [&](const Named& one) {
      return one.name == question.answer.name;
    });
    if (named != by_name_.end()) {
      prepared = named->text;  // stays: a question asked again gets it again
      is_prepared = named->used = true;
    } else if (!in_order_.empty()) {
      prepared = in_order_.front();
      in_order_.pop_front();
      is_prepared = true;
    }
    open_ = question;
  }
  // Out of the lock: answer() takes it too.
  if (is_prepared)
    take_prepared(question.number, prepared);
  else if (assume_answers_)
    assume(question);
  return question.number;
}

/// Answers with what was given in advance. One that does not fit closes the question and throws on:
/// the script reports it, and may ask the next.
void Questions::take_prepared(int number, const std::string& text) {
  try {
    answer(text, "given in advance");
  } catch (const std::exception&) {
    withdraw(number);
    throw;
  }
}

/// The answer of a dry run: the default, else yes, else the first choice. A number always has a
/// fallback.
void Questions::assume(const Question& question) {
  Answer assumed{question.answer.fallback, "", "the dry run"};
  if (question.answer.kind == ParameterKind::flag && !question.has_default) assumed.value = true;
  if (question.answer.kind == ParameterKind::choice && !question.has_default)
    assumed.value = question.answer.choices.front();
  Parameter taken = question.answer;
  taken.fallback = assumed.value;
  assumed.text = default_text(taken);
  const std::lock_guard lock(mutex_);
  // What a person is to do is done in the twin: there, nothing is taken on trust.
  if (question.task.is_null()) assumed_.push_back(shown(question) + ": " + assumed.text);
  answer_ = std::move(assumed);
}

std::vector<std::string> Questions::assumed() const {
  const std::lock_guard lock(mutex_);
  return assumed_;
}

std::optional<Question> Questions::open() const {
  const std::lock_guard lock(mutex_);
  return open_;
}

std::vector<std::string> Questions::unused_answers() const {
  const std::lock_guard lock(mutex_);
  std::vector<std::string> left;
  for (const Named& one : by_name_) {
    if (one.used) continue;
    const std::string near = nearest(one.name, names_);
    // Perhaps a misspelt name: the nearest of those that were asked.
    left.push_back(one.name + "=" + one.text +
                   (near.empty() ? "" : "; did you mean " + near + "?"));
  }
  left.insert(left.end(), in_order_.begin(), in_order_.end());
  return left;
}

// Any thread: terminal, socket and page compete. A wrong answer leaves the question open, so that
// the operator can try again.
void Questions::answer(const std::string& given, const std::string& by) {
  const std::string text = trimmed(given);
  const std::lock_guard lock(mutex_);
  // The first answer counts: another face may have been a moment later.
  if (!open_ || answer_) throw std::invalid_argument("no question is open");
  // An empty line is the default, where there is one.
  if (text.empty() && open_->has_default)
    answer_ = Answer{open_->answer.fallback, default_text(open_->answer), by};
  else
    answer_ = Answer{read_answer(open_->answer, text), text, by};
}

bool Questions::answered() const {
  const std::lock_guard lock(mutex_);
  return answer_.has_value();
}

// Polled by the script's thread, the only one that closes a question with an answer.
std::optional<Questions::Answer> Questions::take() {
  const std::lock_guard lock(mutex_);
  if (!answer_) return std::nullopt;
  open_.reset();
  return std::exchange(answer_, std::nullopt);
}

void Questions::withdraw(int number) {
  const std::lock_guard lock(mutex_);
  // Another question may have been opened since.
  if (!open_ || open_->number != number) return;
  open_.reset();
  answer_.reset();
}

}  // namespace vitreo
