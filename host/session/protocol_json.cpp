// SPDX-License-Identifier: Apache-2.0
#include "host/session/protocol_json.h"

#include <cmath>

namespace vitreo {

nlohmann::json to_json(const Parameter& p) {
  nlohmann::json row = {
      {"name", p.name}, {"kind", to_string(p.kind)}, {"unit", p.unit}, {"help", p.help}};
  std::visit([&row](const auto& held) { row["default"] = held; }, p.fallback);
  if (std::isfinite(p.min)) row["min"] = p.min;
  if (std::isfinite(p.max)) row["max"] = p.max;
  if (p.required) row["required"] = true;
  if (!p.choices.empty()) row["choices"] = p.choices;
  return row;
}

nlohmann::json to_json(const ProtocolDescription& protocol) {
  nlohmann::json parameters = nlohmann::json::array();
  for (const Parameter& p : protocol.parameters) parameters.push_back(to_json(p));
  return {{"name", protocol.name},
          {"file", protocol.file},
          {"title", protocol.title},
          {"about", protocol.about},
          {"needs", protocol.needs},
          {"rig", protocol.rig},
          {"simulated_only", protocol.simulated_only},
          {"parameters", parameters}};
}

}  // namespace vitreo
