// SPDX-License-Identifier: Apache-2.0
#include "host/record/parameter_text.h"

#include "host/text/units.h"

namespace vitreo {
namespace {

std::string unquoted(const nlohmann::json& value) {
  if (value.is_string()) return value.get<std::string>();
  return value.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

/// `number` shows one number. A list, a vector or a range is several of them.
template <class ShowNumber>
std::string shown(const nlohmann::json& value, ShowNumber number) {
  if (value.is_number()) return number(value.get<double>());
  if (!value.is_array()) return unquoted(value);
  std::string joined;
  for (const nlohmann::json& one : value)
    joined += (joined.empty() ? "" : ", ") + shown(one, number);
  return joined;
}

}  // namespace

// Tolerant of what is missing: the record may be of a foreign or a broken run.
std::string parameter_unit(const RunStart& start, const std::string& name) {
  const nlohmann::json& units = start.parameter_units;
  if (!units.is_object() || !units.contains(name) || !units[name].is_string()) return "";
  return units[name].get<std::string>();
}

std::string parameter_text(const RunStart& start, const std::string& name,
                           const nlohmann::json& value) {
  return shown(value, [&](double number) {
    return format_quantity(number, parameter_unit(start, name), kParameterDigits);
  });
}

std::string plain_parameter_text(const RunStart& start, const std::string& name,
                                 const nlohmann::json& value) {
  return shown(value, [&](double number) {
    return plain_quantity(number, parameter_unit(start, name), kParameterDigits);
  });
}

}  // namespace vitreo
