// SPDX-License-Identifier: Apache-2.0
#include "devices/links/likeness.h"

#include "devices/links/scpi.h"

#include <algorithm>
#include <array>
#include <numeric>
#include <string_view>
#include <vector>

namespace vitreo {
namespace {

bool is_digit(char c) { return c >= '0' && c <= '9'; }

/// "@01 0 OK IDLE -- 0" and "@01 0 12 RJ IDLE -- BADCOMMAND" of Zaber's ASCII protocol; its
/// informations (#) and alerts (!) begin alike.
bool is_zaber(std::string_view line) {
  constexpr std::size_t kHead = 6;  // "@01 0 "
  if (line.size() < kHead + 2 || std::string_view("@#!").find(line[0]) == std::string_view::npos ||
      !is_digit(line[1]) || !is_digit(line[2]) || line[3] != ' ' || !is_digit(line[4]) ||
      line[5] != ' ')
    return false;
  if (line[0] == '#') return true;
  std::string_view rest = line.substr(kHead);
  if (rest.size() > 3 && is_digit(rest[0]) && is_digit(rest[1]) && rest[2] == ' ')
    rest.remove_prefix(3);  // the number of the message
  const auto begins = [&rest](std::string_view word) {
    return rest.substr(0, word.size()) == word;
  };
  if (line[0] == '!') return begins("IDLE ") || begins("BUSY ");
  return begins("OK IDLE ") || begins("OK BUSY ") || begins("RJ IDLE ") || begins("RJ BUSY ");
}

/// The answer to *IDN?: four fields, of which the first two are there (IEEE 488.2, 10.14), and the
/// first a maker's name. Empty where it is none.
std::string scpi_name(std::string_view line) {
  const std::vector<std::string> fields = scpi::parts(line);
  const auto letter = [](char c) { return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z'); };
  if (fields.size() != 4 || std::count_if(fields[0].begin(), fields[0].end(), letter) < 2)
    return "";
  const auto who = scpi::identity(line);
  return who ? who->name : "";
}

/// `-113,"Undefined header"`: SCPI's error queue.
bool is_scpi_error(std::string_view line) {
  const auto error = scpi::error(line);
  return error && error->text.size() >= 2 && error->text.front() == '"' &&
         error->text.back() == '"';
}

/// An error of the MP-285 in place of an answer, a letter and CR, and nothing else: '0' and bits.
/// Digits that are two of its bits at once are left out, for other instruments answer by digits.
bool is_mp285(std::string_view text) {
  constexpr std::string_view kErrors = "01248<=";
  if (text.empty() || text.size() % 2 != 0) return false;
  for (std::size_t i = 0; i < text.size(); i += 2)
    if (kErrors.find(text[i]) == std::string_view::npos || text[i + 1] != '\r') return false;
  return true;
}

/// Replies of Trinamic's TMCL: nine bytes, the third a status, the last the sum of the others.
bool is_tmcl(std::span<const std::uint8_t> heard) {
  constexpr std::size_t kSize = 9;
  constexpr std::array<std::uint8_t, 8> kStatus{1, 2, 3, 4, 5, 6, 100, 101};
  if (heard.empty() || heard.size() % kSize != 0) return false;
  for (std::size_t i = 0; i < heard.size(); i += kSize) {
    const auto reply = heard.subspan(i, kSize);
    const int sum = std::accumulate(reply.begin(), reply.end() - 1, 0);
    if (static_cast<std::uint8_t>(sum) != reply.back() ||
        std::find(kStatus.begin(), kStatus.end(), reply[2]) == kStatus.end())
      return false;
  }
  return true;
}

std::vector<std::uint8_t> without_line_ends(std::span<const std::uint8_t> bytes) {
  std::vector<std::uint8_t> kept;
  std::copy_if(bytes.begin(), bytes.end(), std::back_inserter(kept),
               [](std::uint8_t byte) { return byte != '\r' && byte != '\n'; });
  return kept;
}

}  // namespace

// Whole messages first: they would look like nothing line by line.
std::optional<std::string> likeness(std::span<const std::uint8_t> heard) {
  const std::string_view text(reinterpret_cast<const char*>(heard.data()), heard.size());
  if (is_tmcl(heard)) return "a Trinamic module (TMCL)";
  if (is_mp285(text)) return "a Sutter MP-285 that has not understood";
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = std::min(text.find_first_of("\r\n", begin), text.size());
    const std::string line = scpi::trimmed(text.substr(begin, end - begin));
    begin = end + 1;
    if (is_zaber(line)) return "a Zaber device";
    if (const std::string name = scpi_name(line); !name.empty())
      return "the SCPI instrument " + name;
    if (is_scpi_error(line)) return "a SCPI instrument";
  }
  return std::nullopt;
}

bool is_echo(std::span<const std::uint8_t> sent, std::span<const std::uint8_t> heard) {
  const auto there = without_line_ends(sent), back = without_line_ends(heard);
  const std::size_t both = std::min(there.size(), back.size());
  return both >= 2 &&
         std::equal(there.begin(), there.begin() + static_cast<std::ptrdiff_t>(both), back.begin());
}

}  // namespace vitreo
