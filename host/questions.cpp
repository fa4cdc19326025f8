// SPDX-License-Identifier: Apache-2.0
#include "host/questions.h"

#include "host/units.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo {
namespace {

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
  std::string text = answer.kind == ParameterKind::integer ? "a whole number" : quantity_name(dimension);
  if (std::isfinite(answer.min)) text += ", at least " + format_quantity(answer.min, dimension);
  if (std::isfinite(answer.max)) text += ", at most " + format_quantity(answer.max, dimension);
  return text;
}

std::string default_text(const Parameter& answer) {
  if (const bool* flag = std::get_if<bool>(&answer.fallback)) return *flag ? "yes" : "no";
  if (const double* number = std::get_if<double>(&answer.fallback)) {
    const auto unit = find_unit(answer.unit);
    return format_quantity(*number, unit ? std::string(unit->dimension) : "");
  }
  return std::get<std::string>(answer.fallback);
}

}  // namespace

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
    if (equals == std::string::npos || equals == 0)
      in_order_.push_back(answer);
    else
      by_name_.emplace_back(answer.substr(0, equals), answer.substr(equals + 1));
  }
}

int Questions::ask(Question question) {
  std::string prepared;
  bool is_prepared = false;
  {
    const std::lock_guard lock(mutex_);
    question.number = ++asked_;
    answer_.reset();
    const auto named = std::find_if(by_name_.begin(), by_name_.end(),
                                    [&](const auto& pair) { return pair.first == question.answer.name; });
    if (named != by_name_.end()) {
      prepared = named->second;  // stays: a question asked again gets it again
      is_prepared = true;
    } else if (!in_order_.empty()) {
      prepared = in_order_.front();
      in_order_.pop_front();
      is_prepared = true;
    }
    open_ = question;
  }
  if (is_prepared)
    answer(prepared, "given in advance");
  else if (by_themselves_)
    assume(question);
  return question.number;
}

void Questions::assume(const Question& question) {
  Answer assumed{question.answer.fallback, "", "the dry run"};
  if (question.answer.kind == ParameterKind::flag && !question.has_default) assumed.value = true;
  if (question.answer.kind == ParameterKind::choice && !question.has_default)
    assumed.value = question.answer.choices.front();
  Parameter taken = question.answer;
  taken.fallback = assumed.value;
  assumed.text = default_text(taken);
  const std::lock_guard lock(mutex_);
  assumed_.push_back(shown(question) + ": " + assumed.text);
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

void Questions::answer(const std::string& text, const std::string& by) {
  const std::lock_guard lock(mutex_);
  if (!open_ || answer_) throw std::invalid_argument("no question is open");
  if (text.empty() && open_->has_default)
    answer_ = Answer{open_->answer.fallback, default_text(open_->answer), by};
  else
    answer_ = Answer{read_argument(open_->answer, text), text, by};
}

bool Questions::answered() const {
  const std::lock_guard lock(mutex_);
  return answer_.has_value();
}

std::optional<Questions::Answer> Questions::take() {
  const std::lock_guard lock(mutex_);
  if (!answer_) return std::nullopt;
  open_.reset();
  return std::exchange(answer_, std::nullopt);
}

void Questions::withdraw() {
  const std::lock_guard lock(mutex_);
  open_.reset();
  answer_.reset();
}

}  // namespace vitreo
