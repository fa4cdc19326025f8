// Questions to the operator: asked by the script, answered at the terminal, through the control
// socket, or in advance.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/session/script_engine.h"

#include <nlohmann/json.hpp>

#include <deque>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace vitreo {

struct Question {
  int number = 0;            // of this run, from 1
  std::string text;          // "Is the eye fixed?"
  Parameter answer;          // name, kind, unit, range, choices; a flag is yes or no
  bool has_default = false;  // answer.fallback is taken for an empty line
  /// What is to be done before it is answered, for a program that does it in a person's place:
  /// {"do": "insert_robot", "position": [x, y, z] in m, world}. Null: only an answer is wanted.
  nlohmann::json task{};
};

/// As a person reads it: "Is the eye fixed? (yes or no)".
std::string shown(const Question& question);

/// Throws std::invalid_argument for a question that has no valid answer, or whose default is not
/// a valid one.
void check(const Question& question);

/// One open question at a time. Any thread.
class Questions {
 public:
  /// "name=value" for the question of that name, or just "value", taken in their order by questions
  /// that have no answer by name.
  void prepare(const std::vector<std::string>& answers);
  /// Opens a question; its number. An answer prepared for it is taken at once.
  int ask(Question question);
  /// Answers given in advance for which no question came, with the name that was perhaps meant.
  std::vector<std::string> unused_answers() const;
  std::optional<Question> open() const;
  /// For a question of yes or no, y and n do as well. Throws ConfigError saying what is wanted;
  /// std::invalid_argument when no question is open.
  void answer(const std::string& text, const std::string& by);
  struct Answer {
    ArgumentValue value;
    std::string text;
    std::string by;  // "operator at the terminal"
  };
  /// A dry run: what was not answered in advance is answered at once, by its default, by yes, by
  /// the first choice or by the number nearest to 1 in its range; assumed() lists them.
  void assume_answers() { assume_answers_ = true; }
  std::vector<std::string> assumed() const;
  bool answered() const;
  /// The answer, once; the question is closed by it.
  std::optional<Answer> take();
  /// Closes the question of that number, if it is the one that is open: its answer is not waited
  /// for any more.
  void withdraw(int number);

 private:
  struct Named {
    std::string name;
    std::string text;
    bool used = false;
  };
  void take_prepared(int number, const std::string& text);
  void assume(const Question& question);
  mutable std::mutex mutex_;
  std::vector<Named> by_name_;
  std::vector<std::string> names_;  // of the questions that were asked
  std::deque<std::string> in_order_;
  std::optional<Question> open_;
  std::optional<Answer> answer_;
  int asked_ = 0;
  bool assume_answers_ = false;
  std::vector<std::string> assumed_;  // "Is it in? (yes or no): yes"
};

}  // namespace vitreo
