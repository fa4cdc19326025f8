// SPDX-License-Identifier: Apache-2.0
#include "host/record/parameter_text.h"

#include "host/text/units.h"

namespace vitreo {
namespace {

std::string unquoted(const nlohmann::json& value) {
  if (value.is_string()) return value.get<std::string>();
  return value.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
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
  if (!value.is_number()) return unquoted(value);
  return format_quantity(value.get<double>(), parameter_unit(start, name), kParameterDigits);
}

std::string plain_parameter_text(const RunStart& start, const std::string& name,
                                 const nlohmann::json& value) {
  if (!value.is_number()) return unquoted(value);
  return plain_quantity(value.get<double>(), parameter_unit(start, name), kParameterDigits);
}

}  // namespace vitreo
