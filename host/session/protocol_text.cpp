// SPDX-License-Identifier: Apache-2.0
#include "host/session/protocol_text.h"

#include "host/text/columns.h"

#include <fmt/format.h>

#include <cmath>

namespace vitreo {
namespace {

// A declared value is shown as it was written, not rounded to what a result has.
constexpr int kValueDigits = 6;

// Of a flag or a text; numbers have been handled by the caller.
std::string word_of(const ArgumentValue& value) {
  if (const bool* flag = std::get_if<bool>(&value)) return *flag ? "true" : "false";
  return std::get<std::string>(value);
}

/// "one of a, b", "at least 1 mm", "1 mm to 3 mm"; "" where there is no bound.
std::string range_text(const Parameter& p) {
  if (!p.choices.empty()) return fmt::format("one of {}", fmt::join(p.choices, ", "));
  if (!std::isfinite(p.min) && !std::isfinite(p.max)) return "";
  if (!std::isfinite(p.max)) return "at least " + value_text(p.min, p.unit);
  if (!std::isfinite(p.min)) return "at most " + value_text(p.max, p.unit);
  return format_range(p.min, p.max, p.unit);
}

}  // namespace

std::string value_text(const ArgumentValue& value, const std::string& unit) {
  if (const double* number = std::get_if<double>(&value))
    return format_quantity(*number, unit, kValueDigits);
  return word_of(value);
}

std::string plain_value_text(const ArgumentValue& value, const std::string& unit) {
  if (const double* number = std::get_if<double>(&value))
    return plain_quantity(*number, unit, kValueDigits);
  return word_of(value);
}

std::string protocol_text(const ProtocolDescription& protocol) {
  std::string text = protocol.name + ": " + protocol.title + "\n";
  if (!protocol.about.empty()) text += protocol.about + "\n";
  text +=
      "needs: " +
      (protocol.needs.empty() ? "nothing" : fmt::format("{}", fmt::join(protocol.needs, ", "))) +
      "\n";
  if (!protocol.rig.empty()) text += "rig: " + protocol.rig + ", unless another is named\n";
  for (const Parameter& p : protocol.parameters) {
    const std::string range = range_text(p);
    // Name, default, help and range in columns.
    text += fmt::format("  {:<14} {:<12} {}{}{}\n", p.name,
                        p.required ? "(needed)" : value_text(p.fallback, p.unit), p.help,
                        range.empty() || p.help.empty() ? "" : "; ", range);
  }
  return text;
}

}  // namespace vitreo
