// Arguments of a protocol, written name=value, checked against its declaration.
// SPDX-License-Identifier: Apache-2.0
#include "host/config/config.h"
#include "host/session/protocol_text.h"
#include "host/session/script_engine.h"
#include "host/text/columns.h"
#include "host/text/quantity_list.h"

#include <fmt/format.h>

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
/// Without blanks: on the command line a blank ends the word.
std::string example(const Parameter& parameter) {
  std::string text = plain_value_text(parameter, parameter.fallback);
  std::erase(text, ' ');
  return parameter.name + "=" + text;
}

void check_bounds(const Parameter& parameter, double value, const std::string& text) {
  if (value >= parameter.min && value <= parameter.max) return;
  const auto unit = find_unit(parameter.unit);
  fail(parameter.name,
       "wants " + range_text(parameter, unit ? unit->dimension : "") + "; got " + text);
}

/// The value in SI. A bare number is accepted only for a parameter without dimension: 5 could be mm
/// or m.
double read_number(const Parameter& parameter, const std::string& text) {
  const auto unit = find_unit(parameter.unit);
  const std::string dimension(unit ? unit->dimension : "");
  const std::string wanted =
      "wants " + quantity_name(dimension) + ", such as " + example(parameter);
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
  check_bounds(parameter, quantity->value, text);
  return quantity->value;
}

/// "0.1,0.5mm/s", "0,0,-3mm", "0.1..2mm/s".
std::vector<double> read_several(const Parameter& parameter, const std::string& text) {
  std::vector<std::string> items = split_list(text);
  if (parameter.kind == ParameterKind::range) {
    const auto ends = split_range(text);
    if (!ends) fail(parameter.name, "wants a range, such as " + example(parameter));
    items = {ends->first, ends->second};
  }
  std::vector<double> values;
  for (const std::string& item : items) values.push_back(read_number(parameter, item));
  check_several(parameter, values);
  return values;
}

// Lower case only, as Lua writes them.
bool read_flag(const Parameter& parameter, const std::string& text) {
  if (text == "true" || text == "yes" || text == "on") return true;
  if (text == "false" || text == "no" || text == "off") return false;
  fail(parameter.name, "wants true or false; got '" + text + "'");
}

}  // namespace

// Numbers come out in SI, whatever unit was typed.
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
    case ParameterKind::list:
    case ParameterKind::vector:
    case ParameterKind::range:
      return read_several(parameter, text);
  }
  return text;
}

void check_several(const Parameter& parameter, const std::vector<double>& values) {
  const bool vector = parameter.kind == ParameterKind::vector;
  const bool range = parameter.kind == ParameterKind::range;
  if (vector && values.size() != 3)
    fail(parameter.name, fmt::format("wants three numbers, x, y and z, such as {}; got {}",
                                     example(parameter), values.size()));
  if (values.empty()) fail(parameter.name, "wants at least one number");
  if (range && (values.size() != 2 || !(values[0] <= values[1])))
    fail(parameter.name, "wants a range with the least first, such as " + example(parameter));
  for (const double value : values)
    check_bounds(parameter, value, format_quantity(value, parameter.unit));
}

// Seventeen digits at most: the shortest decimal that reads back as the same double.
std::string argument_text(const Parameter& parameter, const ArgumentValue& value) {
  if (const bool* const flag = std::get_if<bool>(&value)) return *flag ? "true" : "false";
  if (const auto* const text = std::get_if<std::string>(&value)) return *text;
  const auto unit = find_unit(parameter.unit);
  const std::string dimension(unit ? unit->dimension : "");
  const auto number = [&dimension](double one) { return fmt::format("{}{}", one, dimension); };
  if (const double* const one = std::get_if<double>(&value)) return number(*one);
  std::string joined;
  for (const double one : std::get<std::vector<double>>(value))
    joined += (joined.empty()                           ? ""
               : parameter.kind == ParameterKind::range ? ".."
                                                        : ",") +
              number(one);
  return joined;
}

const char* to_string(ParameterKind kind) {
  constexpr const char* kNames[] = {"number", "integer", "flag",   "choice",
                                    "text",   "list",    "vector", "range"};
  return kNames[static_cast<std::size_t>(kind)];
}

bool is_several(ParameterKind kind) {
  return kind == ParameterKind::list || kind == ParameterKind::vector ||
         kind == ParameterKind::range;
}

bool is_numeric(ParameterKind kind) {
  return kind == ParameterKind::number || kind == ParameterKind::integer || is_several(kind);
}

const Parameter& parameter_of(const ProtocolDescription& protocol, const std::string& word) {
  std::vector<std::string> known;
  for (const Parameter& parameter : protocol.parameters) known.push_back(parameter.name);
  // The value may hold a "=" itself.
  const std::size_t equals = word.find('=');
  const std::string name = word.substr(0, equals);
  if (equals == std::string::npos || name.empty())
    throw ConfigError("'" + word + "' is not understood: parameters are written name=value");
  const auto parameter = std::find(known.begin(), known.end(), name);
  if (parameter == known.end())
    fail(name, "is not a parameter of " + protocol.name + suggestion(name, known) +
                   (known.empty() ? "; it has none" : "; it has " + listed(known)));
  return protocol.parameters[static_cast<std::size_t>(parameter - known.begin())];
}

// Three passes: what was given, what is missing, what takes its default. The first problem throws,
// and names the parameter.
std::map<std::string, ArgumentValue> check_arguments(const ProtocolDescription& protocol,
                                                     const std::vector<std::string>& words) {
  std::map<std::string, ArgumentValue> values;
  for (const std::string& word : words) {
    const Parameter& parameter = parameter_of(protocol, word);
    if (values.contains(parameter.name)) fail(parameter.name, "is given twice");
    // From the first "=" on: a text may have more of them.
    values[parameter.name] = read_argument(parameter, word.substr(word.find('=') + 1));
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
