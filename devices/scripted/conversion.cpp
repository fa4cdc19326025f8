// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/conversion.h"

#include "devices/links/printable.h"
#include "devices/links/scpi.h"
#include "devices/scripted/lua_values.h"
#include "devices/scripted/pattern.h"
#include "devices/time/error.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>

namespace vitreo::scripted {
namespace {

bool is_digit(char c) { return c >= '0' && c <= '9'; }

/// Where a number begins at `at`: its value, and where it ends.
std::optional<std::pair<double, std::size_t>> number_at(std::string_view text, std::size_t at) {
  std::size_t begin = at;
  if (begin < text.size() && text[begin] == '+') ++begin;
  const std::size_t digits =
      begin < text.size() && text[begin] == '-' && begin == at ? begin + 1 : begin;
  const bool starts = digits < text.size() &&
                      (is_digit(text[digits]) || (text[digits] == '.' && digits + 1 < text.size() &&
                                                  is_digit(text[digits + 1])));
  if (!starts) return std::nullopt;
  double value = 0;
  const char* const first = text.data() + begin;
  // from_chars and not strtod: a point is the decimal sign in every locale; it takes no leading +.
  const auto [stopped, error] = std::from_chars(first, text.data() + text.size(), value);
  if (error != std::errc{} || !std::isfinite(value)) return std::nullopt;
  return std::pair(value, static_cast<std::size_t>(stopped - text.data()));
}

/// A digit that belongs to a word ("MODEL475") begins no number.
bool in_word(std::string_view text, std::size_t at) {
  if (at == 0) return false;
  const char before = text[at - 1];
  return (before >= 'a' && before <= 'z') || (before >= 'A' && before <= 'Z') || before == '_';
}

std::optional<bool> flag_of(const std::string& text) {
  std::string small = text;
  std::transform(small.begin(), small.end(), small.begin(),
                 [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c + 32) : c; });
  if (small == "1" || small == "on" || small == "true" || small == "+1") return true;
  if (small == "0" || small == "off" || small == "false" || small == "+0") return false;
  return std::nullopt;
}

// Bounds are declared in round numbers of another unit: six digits show them as they were meant.
std::string number_text(double number) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", number);
  return text;
}

}  // namespace

std::vector<double> numbers_in(std::string_view text) {
  std::vector<double> found;
  for (std::size_t at = 0; at < text.size();) {
    const auto number = in_word(text, at) ? std::nullopt : number_at(text, at);
    if (number) found.push_back(number->first);
    at = number ? number->second : at + 1;
  }
  return found;
}

std::optional<double> first_number(std::string_view text) {
  for (std::size_t at = 0; at < text.size(); ++at)
    if (const auto number = in_word(text, at) ? std::nullopt : number_at(text, at))
      return number->first;
  return std::nullopt;
}

std::optional<QuantityValue> value_of(const PropertyDeclaration& property, std::string_view text) {
  const std::string plain = scpi::trimmed(text);
  switch (property.info.type) {
    case QuantityType::number: {
      const auto number = first_number(plain);
      if (!number) return std::nullopt;
      return property.unit.to_si(*number);
    }
    case QuantityType::numbers: {
      std::vector<double> all = numbers_in(plain);
      if (all.empty()) return std::nullopt;
      for (double& one : all) one = property.unit.to_si(one);
      return all;
    }
    case QuantityType::flag: {
      const auto flag = flag_of(plain);
      if (!flag) return std::nullopt;
      return *flag;
    }
    case QuantityType::text:
      break;
  }
  // The answer is the instrument's own word, the value the name that the file gave it.
  if (property.choices.empty()) return plain;
  for (const auto& [name, code] : property.choices)
    if (code == plain) return name;
  return std::nullopt;
}

std::string message_for(Sandbox& sandbox, const std::string& format,
                        const std::vector<QuantityValue>& values) {
  lua_State* const L = sandbox.stack();
  // The host's own copy: the file may have put another function in its place.
  sandbox.push_string_function("format");
  lua_pushlstring(L, format.data(), format.size());
  for (const QuantityValue& value : values) push_quantity(L, value);
  sandbox.call(1 + static_cast<int>(values.size()), 1);
  std::string message(lua_tostring(L, -1), lua_rawlen(L, -1));
  lua_pop(L, 1);
  return message;
}

std::optional<std::vector<std::string>> captures(Sandbox& sandbox, const std::string& text,
                                                 const std::string& pattern) {
  constexpr std::int64_t kMostSteps = 200'000;  // a millisecond
  PatternSteps steps(kMostSteps);
  std::optional<PatternMatch> match;
  try {
    match = find_pattern(text, pattern, 0, steps);
  } catch (const std::runtime_error& error) {
    throw ScriptFault(sandbox.file() + ": pattern \"" + printable(pattern, 80) +
                      "\": " + error.what());
  }
  if (!match) return std::nullopt;
  // As string.match: the whole match where the pattern has no captures, a position counted from 1.
  if (match->captures.empty()) return {{text.substr(match->begin, match->end - match->begin)}};
  std::vector<std::string> found;
  for (const PatternCapture& one : match->captures)
    found.push_back(one.position ? std::to_string(one.begin + 1)
                                 : text.substr(one.begin, one.size));
  return found;
}

QuantityValue to_declared(const QuantityValue& value, const DeclaredUnit& unit,
                          const std::map<std::string, std::string>& choices) {
  if (const auto* number = std::get_if<double>(&value)) return unit.from_si(*number);
  if (const auto* name = std::get_if<std::string>(&value)) {
    const auto code = choices.find(*name);
    if (code != choices.end()) return code->second;
  }
  if (const auto* list = std::get_if<std::vector<double>>(&value)) {
    std::vector<double> declared = *list;
    for (double& one : declared) one = unit.from_si(one);
    return declared;
  }
  return value;
}

void check_value(const QuantityInfo& info, const QuantityValue& value, const std::string& device) {
  const bool fits =
      (info.type == QuantityType::number && std::holds_alternative<double>(value)) ||
      (info.type == QuantityType::flag && std::holds_alternative<bool>(value)) ||
      (info.type == QuantityType::text && std::holds_alternative<std::string>(value)) ||
      (info.type == QuantityType::numbers && std::holds_alternative<std::vector<double>>(value));
  if (!fits) throw std::invalid_argument(info.name + ": is of another type");
  const auto inside = [&](double number) {
    if (!std::isfinite(number)) throw std::invalid_argument(info.name + ": must be finite");
    if (number < info.min || number > info.max)
      throw DeviceError(DeviceErrorKind::out_of_range, device,
                        info.name + ": " + number_text(number) + " " + info.unit + " is not " +
                            number_text(info.min) + " to " + number_text(info.max) + " " +
                            info.unit);
  };
  if (const auto* number = std::get_if<double>(&value)) inside(*number);
  if (const auto* list = std::get_if<std::vector<double>>(&value))
    for (const double number : *list) inside(number);
  const auto* const text = std::get_if<std::string>(&value);
  if (text != nullptr && !info.choices.empty() &&
      std::find(info.choices.begin(), info.choices.end(), *text) == info.choices.end()) {
    std::string all;
    for (const std::string& choice : info.choices) all += (all.empty() ? "" : ", ") + choice;
    throw DeviceError(DeviceErrorKind::out_of_range, device,
                      info.name + ": " + printable(*text) + " is none of " + all);
  }
}

}  // namespace vitreo::scripted
