// SPDX-License-Identifier: Apache-2.0
#include "optics/system/zemax_text.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <stdexcept>

namespace vitreo::optics::detail {
namespace {

/// A prescription takes some kilobytes.
constexpr std::size_t kMostBytes = 8u << 20;

/// Of a code point of the basic plane: one to three bytes.
/// Zemax writes UTF-16; everything behind this file is UTF-8.
void append_utf8(std::string& text, std::uint32_t code) {
  const auto byte = [&](std::uint32_t value) { text.push_back(static_cast<char>(value)); };
  if (code < 0x80) return byte(code);
  if (code < 0x800) {
    byte(0xC0 | code >> 6);
  } else {
    byte(0xE0 | code >> 12);
    byte(0x80 | (code >> 6 & 0x3F));
  }
  byte(0x80 | (code & 0x3F));
}

/// Code units beyond the basic plane, which occur in comments at most, become question marks.
std::string utf8_from_utf16(std::string_view bytes, bool big_endian) {
  if (bytes.size() % 2 != 0)
    throw std::invalid_argument("line 1: UTF-16 text with half a character at its end");
  std::string text;
  text.reserve(bytes.size() / 2);
  for (std::size_t i = 0; i < bytes.size(); i += 2) {
    const auto low = static_cast<std::uint8_t>(bytes[i + (big_endian ? 1 : 0)]);
    const auto high = static_cast<std::uint8_t>(bytes[i + (big_endian ? 0 : 1)]);
    const std::uint32_t code = static_cast<std::uint32_t>(high) << 8 | low;
    append_utf8(text, code >= 0xD800 && code < 0xE000 ? '?' : code);
  }
  return text;
}

/// By the byte order mark, since Zemax writes UTF-16 little endian and other programs UTF-8.
std::string decode(std::string_view bytes) {
  if (bytes.size() > kMostBytes)
    throw std::invalid_argument("line 1: the file is too large for a lens");
  const auto begins = [&](std::string_view mark) { return bytes.substr(0, mark.size()) == mark; };
  std::string text;
  if (begins("\xFF\xFE")) {
    text = utf8_from_utf16(bytes.substr(2), false);
  } else if (begins("\xFE\xFF")) {
    text = utf8_from_utf16(bytes.substr(2), true);
  } else {
    text = bytes.substr(begins("\xEF\xBB\xBF") ? 3 : 0);
  }
  // UTF-16 without a mark shows as zero bytes between the letters.
  if (text.find('\0') != std::string::npos) {
    throw std::invalid_argument("line 1: not a text (UTF-16 needs its byte order mark)");
  }
  return text;
}

constexpr const char* kBlank = " \t\r\f\v";

/// The operand, the rest as it stands (titles keep their blanks) and its words.
/// `number` counts all lines of the file from 1, for messages.
ZemaxLine line_from(std::string_view text, int number) {
  ZemaxLine line;
  line.number = number;
  line.indented = text.front() == ' ' || text.front() == '\t';
  std::size_t at = text.find_first_not_of(kBlank);
  bool first = true;
  while (at != std::string_view::npos) {
    const std::size_t end = std::min(text.find_first_of(kBlank, at), text.size());
    const std::string word(text.substr(at, end - at));
    if (first) {
      line.operand = word;
    } else {
      if (line.words.empty()) line.rest = text.substr(at, text.find_last_not_of(kBlank) + 1 - at);
      line.words.push_back(word);
    }
    first = false;
    at = text.find_first_not_of(kBlank, end);
  }
  return line;
}

}  // namespace

void ZemaxLine::refuse(const std::string& why) const {
  constexpr std::size_t kMost = 40;  // of a broken file, a "word" can be anything
  throw std::invalid_argument("line " + std::to_string(number) + ": " + operand.substr(0, kMost) +
                              ": " + why);
}

/// Throws naming line and operand for a word that is missing, no number, not finite or followed by
/// anything.
double ZemaxLine::number_at(std::size_t index, const char* what) const {
  if (index >= words.size()) refuse(std::string(what) + " is missing");
  std::string_view word = words[index];
  if (!word.empty() && word.front() == '+') word.remove_prefix(1);
  double value = 0;
  // std::from_chars ignores the locale and, unlike Zemax, takes no leading plus.
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc{} || end != word.data() + word.size() || !std::isfinite(value)) {
    refuse(std::string(what) + " \"" + std::string(word.substr(0, 40)) +
           "\" is not a finite number");
  }
  return value;
}

/// Within a million, so that the conversion to int is exact.
int ZemaxLine::integer_at(std::size_t index, const char* what) const {
  const double value = number_at(index, what);
  if (!(std::abs(value) <= 1e6) || value != std::floor(value))
    refuse(std::string(what) + " is not a whole number");
  return static_cast<int>(value);
}

/// Blank lines count for the numbering and are left out; a carriage return is a blank.
std::vector<ZemaxLine> zemax_lines(std::string_view bytes) {
  const std::string text = decode(bytes);
  std::vector<ZemaxLine> lines;
  int number = 0;
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    const std::string_view line = std::string_view(text).substr(begin, end - begin);
    ++number;
    if (line.find_first_not_of(kBlank) != std::string_view::npos)
      lines.push_back(line_from(line, number));
    begin = end + 1;
  }
  return lines;
}

}  // namespace vitreo::optics::detail
