// SCPI: the syntax that its instruments have in common, one line as a question, one line as its
// answer, and an error queue.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/identity.h"

#include <charconv>
#include <cmath>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace vitreo::scpi {

/// Without the blanks and control characters round it, and without XON (0x11) and XOFF (0x13),
/// which flow control may put anywhere.
inline std::string trimmed(std::string_view text) {
  std::string kept;
  for (const char c : text)
    if (c != 0x11 && c != 0x13) kept.push_back(c);
  const auto blank = [](char c) { return c == ' ' || (c >= 0 && c < 0x20); };
  while (!kept.empty() && blank(kept.back())) kept.pop_back();
  std::size_t begin = 0;
  while (begin < kept.size() && blank(kept[begin])) ++begin;
  return kept.substr(begin);
}

/// The parts between commas (or another character), trimmed.
inline std::vector<std::string> parts(std::string_view text, char separator = ',') {
  std::vector<std::string> found;
  for (std::size_t begin = 0;;) {
    const std::size_t end = text.find(separator, begin);
    found.push_back(trimmed(text.substr(begin, end == std::string_view::npos ? end : end - begin)));
    if (end == std::string_view::npos) return found;
    begin = end + 1;
  }
}

/// "2.71E1", "+0.5"; nothing for anything else, not for infinite ones either.
inline std::optional<double> number(std::string_view text) {
  const std::string plain = trimmed(text);
  const char* begin = plain.data();
  const char* const end = begin + plain.size();
  if (begin != end && *begin == '+') ++begin;
  if (begin != end && *begin == '-' && begin != plain.data()) return std::nullopt;  // "+-1"
  double value = 0;
  const auto [stopped, error] = std::from_chars(begin, end, value);
  if (begin == end || error != std::errc{} || stopped != end || !std::isfinite(value))
    return std::nullopt;
  return value;
}

/// From the answer to *IDN?: maker, model, serial number, firmware. Nothing when there is no maker
/// or no model.
inline std::optional<Identity> identity(std::string_view answer) {
  const std::vector<std::string> all = parts(answer);
  if (all.size() < 2 || all[0].empty() || all[1].empty()) return std::nullopt;
  for (const char c : answer)
    if (c < 0x20 && c != '\r' && c != '\n' && c != 0x11 && c != 0x13) return std::nullopt;
  return Identity{all[0] + " " + all[1], all.size() > 2 ? all[2] : "",
                  all.size() > 3 ? all[3] : ""};
}

/// From the answer to SYST:ERR?: `-222,"Data out of range"`.
struct Error {
  int code = 0;
  std::string text;
};
inline std::optional<Error> error(std::string_view answer) {
  const std::string plain = trimmed(answer);
  const std::size_t comma = plain.find(',');
  const auto code = number(std::string_view(plain).substr(0, comma));
  if (!code || std::abs(*code) > 32767 || *code != std::floor(*code)) return std::nullopt;
  return Error{static_cast<int>(*code), comma == std::string::npos ? "" : plain.substr(comma + 1)};
}

}  // namespace vitreo::scpi
