// Arguments of a protocol, written name=value, checked against its declaration.
// SPDX-License-Identifier: Apache-2.0
#include "host/config/config.h"
#include "host/session/script_engine.h"
#include "host/text/columns.h"

#include <algorithm>
#include <cmath>

namespace vitreo {
namespace {

[[noreturn]] void fail(const std::string& name, const std::string& problem) {
  throw ConfigError(name + ": " + problem);
}

/// "; did you mean speed?", or "" where no known word is near.
std::string suggestion(const std::string& word, const std::vector<std::string>& known) {
  const std::string near = nearest(word, known);
  return near.empty() ? "" : "; did you mean " + near + "?";
}

std::string listed(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : ", ") + word;
  return text;
}

/// Range in the display unit, for messages.
std::string range_text(const Parameter& parameter, std::string_view dimension) {
  const std::string min = format_quantity(parameter.min, dimension);
  const std::string max = format_quantity(parameter.max, dimension);
  if (std::isinf(parameter.max)) return "at least " + min;
  if (std::isinf(parameter.min)) return "at most " + max;
  return format_range(parameter.min, parameter.max, dimension);
}

/// The default as an argument: "speed=5um/s".
std::string example(const Parameter& parameter, std::string_view dimension) {
  std::string text = plain_quantity(std::get<double>(parameter.fallback), dimension);
  std::erase(text, ' ');
  return parameter.name + "=" + text;
}

/// The value in SI. A bare number is accepted only for a parameter without dimension: 5 could be mm
/// or m.
double read_number(const Parameter& parameter, const std::string& text) {
  const auto unit = find_unit(parameter.unit);
  const std::string dimension(unit ? unit->dimension : "");
  const std::string wanted =
      "wants " + quantity_name(dimension) + ", such as " + example(parameter, dimension);
  const auto quantity = parse_quantity(text);
  if (!quantity)
    fail(parameter.name, wanted + "; '" + text + "' is not a number with a unit that is known");
  // The message has the word to write instead, in the unit of the declaration.
  if (quantity->bare && !dimension.empty())
    fail(parameter.name, wanted + "; " + text + " has no unit: write " + text + parameter.unit);
  if (quantity->dimension != dimension)
    fail(parameter.name, wanted + "; " + text + " is " + quantity_name(quantity->dimension));
  if (parameter.kind == ParameterKind::integer && quantity->value != std::floor(quantity->value))
    fail(parameter.name, "wants a whole number; got " + text);
  if (quantity->value < parameter.min || quantity->value > parameter.max)
    fail(parameter.name, "wants " + range_text(parameter, dimension) + "; got " + text);
  return quantity->value;
}

// Lower case only, as Lua writes them.
bool read_flag(const Parameter& parameter, const std::string& text) {
  if (text == "true" || text == "yes" || text == "on") return true;
  if (text == "false" || text == "no" || text == "off") return false;
  fail(parameter.name, "wants true or false; got '" + text + "'");
}

}  // namespace

ArgumentValue read_argument(const Parameter& parameter, const std::string& text) {
  switch (parameter.kind) {
    case ParameterKind::number:
    case ParameterKind::integer:
      return read_number(parameter, text);
    case ParameterKind::flag:
      return read_flag(parameter, text);
    case ParameterKind::choice:
      if (std::find(parameter.choices.begin(), parameter.choices.end(), text) ==
          parameter.choices.end())
        fail(parameter.name, "wants one of " + listed(parameter.choices) + "; got '" + text + "'" +
                                 suggestion(text, parameter.choices));
      return text;
    case ParameterKind::text:
      return text;
  }
  return text;
}

// Three passes: what was given, what is missing, what takes its default. The first problem throws,
// and names the parameter.
std::map<std::string, ArgumentValue> check_arguments(const ProtocolDescription& protocol,
                                                     const std::vector<std::string>& words) {
  std::vector<std::string> known;
  for (const Parameter& parameter : protocol.parameters) known.push_back(parameter.name);
  std::map<std::string, ArgumentValue> values;
  for (const std::string& word : words) {
    // The value may hold a "=" itself.
    const std::size_t equals = word.find('=');
    const std::string name = word.substr(0, equals);
    if (equals == std::string::npos || name.empty())
      throw ConfigError("'" + word + "' is not understood: parameters are written name=value");
    const auto parameter = std::find(known.begin(), known.end(), name);
    if (parameter == known.end())
      fail(name, "is not a parameter of " + protocol.name + suggestion(name, known) +
                     (known.empty() ? "; it has none" : "; it has " + listed(known)));
    if (values.contains(name)) fail(name, "is given twice");
    const auto at = static_cast<std::size_t>(parameter - known.begin());
    values[name] = read_argument(protocol.parameters[at], word.substr(equals + 1));
  }
  for (const Parameter& parameter : protocol.parameters)
    if (parameter.required && !values.contains(parameter.name))
      fail(parameter.name,
           "is missing; it is " + (parameter.help.empty() ? "needed" : parameter.help));
  // Defaults; try_emplace() leaves those that were given.
  for (const Parameter& parameter : protocol.parameters)
    values.try_emplace(parameter.name, parameter.fallback);
  return values;
}

}  // namespace vitreo
