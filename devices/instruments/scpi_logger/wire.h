// Wire of a data logger that scans voltages, HP/Agilent/Keysight 34970A and Keysight DAQ970A; no
// I/O. Sources: 34970A User's Guide, chapters 4 and 5; DAQ970A/DAQ973A Programming Guide.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/scpi.h"

#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace vitreo::scpi_logger {

constexpr std::size_t kMaxAnswer = 1024;
/// What stands in a reading's place beyond the range: SCPI's infinity.
constexpr double kOverload = 9.9e37;

/// "(@101,102,108)".
inline std::string channel_list(const std::vector<int>& channels) {
  std::string list;
  for (const int channel : channels) list += (list.empty() ? "" : ",") + std::to_string(channel);
  return "(@" + list + ")";
}

/// "+1.5E+00,101,-2.0E-03,102": each reading with its channel (FORMat:READing:CHANnel ON), V by
/// channel. Nothing when it is anything else, or a channel comes twice.
inline std::optional<std::map<int, double>> decode_sweep(std::string_view answer) {
  const std::vector<std::string> parts = scpi::parts(answer);
  if (parts.size() % 2 != 0) return std::nullopt;
  std::map<int, double> volts;
  for (std::size_t i = 0; i < parts.size(); i += 2) {
    const auto value = scpi::number(parts[i]);
    const auto channel = scpi::number(parts[i + 1]);
    if (!value || !channel || *channel != static_cast<int>(*channel)) return std::nullopt;
    if (!volts.emplace(static_cast<int>(*channel), *value).second) return std::nullopt;
  }
  return volts;
}

}  // namespace vitreo::scpi_logger
