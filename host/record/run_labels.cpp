// SPDX-License-Identifier: Apache-2.0
#include "host/record/run_labels.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdio>
#include <ctime>
#include <stdexcept>

namespace vitreo {
namespace {

constexpr std::size_t kLongest = 1000;  // bytes

/// One line, as labels stand in lists and in the cells of tables.
void check_value(const std::string& name, const std::string& value) {
  const auto control = [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; };
  if (value.empty()) throw std::invalid_argument(name + ": wants a text, got an empty one");
  if (value.size() > kLongest)
    throw std::invalid_argument(fmt::format("{}: is longer than {} bytes", name, kLongest));
  if (std::any_of(value.begin(), value.end(), control))
    throw std::invalid_argument(name + ": wants a text of one line");
}

[[noreturn]] void no_time(const std::string& text) {
  throw std::invalid_argument(
      "wants a time such as 2026-11-24T08:10 or "
      "2026-11-24T08:10+01:00, got " +
      text);
}

/// Seconds east of Greenwich of "Z", "+01:00", "+0100"; a local time has "".
long offset_of(const std::string& text, const std::string& whole) {
  if (text == "Z") return 0;
  int hours = 0;
  int minutes = 0;
  char sign = 0;
  int used = 0;
  if (std::sscanf(text.c_str(), "%c%2d:%2d%n", &sign, &hours, &minutes, &used) < 3 &&
      std::sscanf(text.c_str(), "%c%2d%2d%n", &sign, &hours, &minutes, &used) < 3)
    no_time(whole);
  // No zone is farther from UTC than 14 h. The lower bounds are needed, as %2d takes a sign too.
  const bool fits = (sign == '+' || sign == '-') && hours >= 0 && hours <= 14 && minutes >= 0 &&
                    minutes < 60 && static_cast<std::size_t>(used) == text.size();
  if (!fits) no_time(whole);
  return (sign == '-' ? -1 : 1) * (hours * 3600L + minutes * 60L);
}

/// ISO 8601 as UTC to the second: "2026-11-24T07:10:00Z".
std::string utc_second(const std::string& text) {
  std::tm parts{};
  int used = 0;
  char between = 0;
  if (std::sscanf(text.c_str(), "%4d-%2d-%2d%c%2d:%2d%n", &parts.tm_year, &parts.tm_mon,
                  &parts.tm_mday, &between, &parts.tm_hour, &parts.tm_min, &used) < 6 ||
      (between != 'T' && between != ' '))
    no_time(text);
  auto at = static_cast<std::size_t>(used);
  int more = 0;
  // Seconds may be left out: a time that a person wrote down is one to the minute.
  if (std::sscanf(text.c_str() + at, ":%2d%n", &parts.tm_sec, &more) == 1)
    at += static_cast<std::size_t>(more);
  const std::string rest = text.substr(at);
  // std::tm counts years from 1900 and months from 0.
  parts.tm_year -= 1900;
  parts.tm_mon -= 1;
  // Whether summer time holds is the C library's to find out, by the host's time zone.
  parts.tm_isdst = -1;
  const std::tm given = parts;
  std::time_t seconds = 0;
  // A time without an offset is that of the host's zone: a person read it off a clock there.
  if (rest.empty())
    seconds = mktime(&parts);
  else
    seconds = timegm(&parts) - offset_of(rest, text);
  // The 31st of a month that has none becomes the first of the next one: that is a mistake.
  // The hour is not compared: in the gap of summer time mktime() moves it on by one.
  if (parts.tm_mday != given.tm_mday || parts.tm_mon != given.tm_mon ||
      parts.tm_min != given.tm_min || parts.tm_sec != given.tm_sec)
    no_time(text);
  std::tm utc{};
  gmtime_r(&seconds, &utc);
  std::array<char, 32> shown{};
  std::strftime(shown.data(), shown.size(), "%Y-%m-%dT%H:%M:%SZ", &utc);
  return shown.data();
}

}  // namespace

// A key that is there already is replaced.
void set_tag(nlohmann::json& tags, const std::string& key, const std::string& value) {
  const auto in_word = [](char c) {
    return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_' || c == '-' || c == '.';
  };
  if (key.empty() || std::isalpha(static_cast<unsigned char>(key[0])) == 0 ||
      !std::all_of(key.begin(), key.end(), in_word) || key.size() > 100)
    throw std::invalid_argument("tag: wants a key of letters, digits, _, - and ., got '" + key +
                                "'");
  check_value("tag " + key, value);
  tags[key] = value;
}

const std::vector<std::string>& sample_fields() {
  static const std::vector<std::string> kFields{"eye",     "species", "age",   "died",
                                                "removed", "pipette", "light", "robot"};
  return kFields;
}

void set_sample_field(nlohmann::json& sample, const std::string& field, const std::string& value) {
  const auto& fields = sample_fields();
  if (std::find(fields.begin(), fields.end(), field) == fields.end())
    throw std::invalid_argument(
        fmt::format("sample: has no '{}', only {}", field, fmt::join(fields, ", ")));
  check_value("sample " + field, value);
  // The two times become UTC, so that the sample's age follows from records of any place.
  if (field != "died" && field != "removed") {
    sample[field] = value;
    return;
  }
  try {
    sample[field] = utc_second(value);
  } catch (const std::invalid_argument& problem) {
    throw std::invalid_argument(field + ": " + problem.what());
  }
}

std::pair<std::string, std::string> key_and_value(const std::string& word) {
  // The first sign divides the word: the value may hold others.
  const std::size_t sign = word.find('=');
  if (sign == std::string::npos) throw std::invalid_argument("wants key=value, got '" + word + "'");
  return {word.substr(0, sign), word.substr(sign + 1)};
}

}  // namespace vitreo
