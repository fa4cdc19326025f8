// The text layer of the Zemax format: encodings, lines, words, numbers and their errors.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace vitreo::optics::detail {

/// One line: the operand in front and what follows.
struct ZemaxLine {
  int number = 0;  // from 1
  bool indented = false;
  std::string operand;
  std::string rest;                // as it stands
  std::vector<std::string> words;  // of the rest

  /// Throws std::invalid_argument "line N: OPERAND: why".
  [[noreturn]] void refuse(const std::string& why) const;
  /// The word at `index` as a finite number, or a refusal that calls it `what`.
  double number_at(std::size_t index, const char* what) const;
  int integer_at(std::size_t index, const char* what) const;
};

/// The non-empty lines of a file in UTF-8, or UTF-16 with a byte order mark. Throws
/// std::invalid_argument for bytes that are neither, and for files that are too large to be meant.
std::vector<ZemaxLine> zemax_lines(std::string_view bytes);

}  // namespace vitreo::optics::detail
