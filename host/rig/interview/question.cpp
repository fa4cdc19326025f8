// SPDX-License-Identifier: Apache-2.0
#include "host/rig/interview/question.h"

#include "host/text/terminal_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <sstream>

namespace vitreo {
namespace {

/// One line, broken at blanks; what follows is indented as its begin is, and by two more in a list.
std::string wrapped_line(const std::string& line) {
  constexpr std::size_t kWidth = 80;
  const std::size_t begin = std::min(line.find_first_not_of(' '), line.size());
  const std::string indent(begin == 0 ? 0 : begin + 2, ' ');
  std::string text, row = line.substr(0, begin);
  std::istringstream words(line.substr(begin));
  bool first = true;
  for (std::string word; std::getline(words, word, ' '); first = false) {
    if (!first && columns_of(row) + 1 + columns_of(word) > kWidth) {
      text += row + "\n";
      row = indent + word;
    } else {
      row += (first ? "" : " ") + word;
    }
  }
  return text + row;
}

}  // namespace

std::string wrapped(const std::string& text) {
  std::string made;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find('\n', at), text.size());
    made += wrapped_line(text.substr(at, end - at));
    if (end < text.size()) made += '\n';
    at = end + 1;
  }
  return made;
}

std::string to_text(const InterviewQuestion& question) {
  std::string text = question.text;
  std::size_t widest = 0;
  for (const AnswerOption& option : question.options) widest = std::max(widest, option.word.size());
  for (std::size_t i = 0; i < question.options.size(); ++i) {
    text += fmt::format("\n  {}  {:<{}}  {}", i + 1, question.options[i].word, widest,
                        question.options[i].text);
    text.erase(text.find_last_not_of(' ') + 1);
  }
  if (!question.options.empty()) text += question.fallback.empty() ? "\n  (number or word)" : "\n ";
  if (!question.wanted.empty()) text += " (" + question.wanted + ")";
  if (!question.fallback.empty()) text += " [" + question.fallback + "]";
  return question.before + wrapped(text) + ": ";
}

}  // namespace vitreo
