// Wire of a teslameter with plain SCPI: *IDN?, one question for the field, one line of numbers as
// its answer; no I/O.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/scpi.h"

#include <array>
#include <cstdio>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace vitreo::scpi_probe {

constexpr std::size_t kMaxAnswer = 256;
/// What instruments answer in a number's place when the field is beyond their range: SCPI's
/// infinity, 9.9E37.
constexpr double kOverload = 9.9e37;

/// "1.2E-3,-4.5E-3,0.1E-3": exactly `axes` numbers, in the instrument's unit. Nothing when it is
/// anything else.
inline std::optional<std::vector<double>> decode_field(std::string_view answer, std::size_t axes) {
  std::vector<double> field;
  for (const std::string& part : scpi::parts(answer)) {
    const auto value = scpi::number(part);
    if (!value) return std::nullopt;
    field.push_back(*value);
  }
  if (field.size() != axes) return std::nullopt;
  return field;
}

inline std::string encode_field(const std::vector<double>& field) {
  std::string text;
  for (const double component : field) {
    std::array<char, 32> number{};
    std::snprintf(number.data(), number.size(), "%+.6E", component);
    text += (text.empty() ? "" : ",") + std::string(number.data());
  }
  return text;
}

}  // namespace vitreo::scpi_probe
