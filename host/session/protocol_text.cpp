// SPDX-License-Identifier: Apache-2.0
#include "host/session/protocol_text.h"

#include "host/text/columns.h"

#include <fmt/format.h>

#include <cmath>

namespace vitreo {
namespace {

// A declared value is shown as it was written, not rounded to what a result has.
constexpr int kValueDigits = 6;

/// `number` shows one number.
template <class ShowNumber>
std::string text_of(const Parameter& parameter, const ArgumentValue& value, const char* comma,
                    ShowNumber number) {
  if (const bool* flag = std::get_if<bool>(&value)) return *flag ? "true" : "false";
  if (const auto* text = std::get_if<std::string>(&value)) return *text;
  if (const double* one = std::get_if<double>(&value)) return number(*one);
  std::string joined;
  for (const double one : std::get<std::vector<double>>(value))
    joined += (joined.empty()                           ? ""
               : parameter.kind == ParameterKind::range ? ".."
                                                        : comma) +
              number(one);
  return joined;
}

/// "one of a, b", "at least 1 mm", "1 mm to 3 mm"; "" where there is no bound.
std::string range_text(const Parameter& p) {
  if (!p.choices.empty()) return fmt::format("one of {}", fmt::join(p.choices, ", "));
  if (!std::isfinite(p.min) && !std::isfinite(p.max)) return "";
  const std::string each = is_several(p.kind) ? "each " : "";
  if (!std::isfinite(p.max)) return each + "at least " + value_text(p, p.min);
  if (!std::isfinite(p.min)) return each + "at most " + value_text(p, p.max);
  return each + format_range(p.min, p.max, p.unit);
}

}  // namespace

std::string value_text(const Parameter& parameter, const ArgumentValue& value) {
  return text_of(parameter, value, ", ", [&parameter](double number) {
    return format_quantity(number, parameter.unit, kValueDigits);
  });
}

std::string plain_value_text(const Parameter& parameter, const ArgumentValue& value) {
  return text_of(parameter, value, ",", [&parameter](double number) {
    return plain_quantity(number, parameter.unit, kValueDigits);
  });
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
                        p.required ? "(needed)" : value_text(p, p.fallback), p.help,
                        range.empty() || p.help.empty() ? "" : "; ", range);
  }
  return text;
}

}  // namespace vitreo
