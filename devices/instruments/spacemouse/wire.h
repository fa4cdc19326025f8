// Wire of the SpaceMouse: input reports encoded and decoded; no I/O. Byte 0 is the report's id,
// then 16-bit little-endian deflections in [-350, 350] or a bit mask of buttons (spacenavd's device
// table; AndunHH/spacemouse).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <variant>
#include <vector>

namespace vitreo::spacemouse {

using Bytes = std::span<const std::uint8_t>;
using Report = std::vector<std::uint8_t>;

constexpr std::uint8_t kTranslation = 1;
constexpr std::uint8_t kRotation = 2;
constexpr std::uint8_t kButtons = 3;
constexpr int kFullScale_counts = 350;

/// Device axes: x right, y towards the operator, z down.
using Axes = std::array<std::int16_t, 3>;
struct Translation {
  Axes counts{};
};
struct Rotation {
  Axes counts{};
};
struct Both {  ///< the wireless family sends all six in one report
  Axes translation{};
  Axes rotation{};
};
struct Buttons {
  std::uint32_t pressed = 0;
};
using Input = std::variant<Translation, Rotation, Both, Buttons>;

namespace detail {
inline void put(Report& report, const Axes& axes) {
  for (const std::int16_t axis : axes) {
    const auto bits = static_cast<std::uint16_t>(axis);
    report.push_back(static_cast<std::uint8_t>(bits & 0xFF));
    report.push_back(static_cast<std::uint8_t>(bits >> 8));
  }
}
inline Axes get(Bytes b, std::size_t at) {
  Axes axes{};
  for (std::size_t i = 0; i < axes.size(); ++i)
    axes[i] = static_cast<std::int16_t>(b[at + 2 * i] | b[at + 2 * i + 1] << 8);
  return axes;
}
}  // namespace detail

inline Report encode(const Input& input) {
  Report report;
  if (const auto* t = std::get_if<Translation>(&input)) {
    report = {kTranslation};
    detail::put(report, t->counts);
  } else if (const auto* r = std::get_if<Rotation>(&input)) {
    report = {kRotation};
    detail::put(report, r->counts);
  } else if (const auto* both = std::get_if<Both>(&input)) {
    report = {kTranslation};
    detail::put(report, both->translation);
    detail::put(report, both->rotation);
  } else {
    const std::uint32_t pressed = std::get<Buttons>(input).pressed;
    report = {kButtons, static_cast<std::uint8_t>(pressed),
              static_cast<std::uint8_t>(pressed >> 8)};
  }
  return report;
}

/// Nothing when the report is another one (battery, LED) or cut short.
inline std::optional<Input> decode(Bytes b) {
  if (b.empty()) return std::nullopt;
  if (b[0] == kTranslation && b.size() >= 13) return Both{detail::get(b, 1), detail::get(b, 7)};
  if (b[0] == kTranslation && b.size() >= 7) return Translation{detail::get(b, 1)};
  if (b[0] == kRotation && b.size() >= 7) return Rotation{detail::get(b, 1)};
  if (b[0] == kButtons && b.size() >= 2) {
    std::uint32_t pressed = 0;
    for (std::size_t i = 1; i < std::min<std::size_t>(b.size(), 5); ++i)
      pressed |= std::uint32_t{b[i]} << 8 * (i - 1);
    return Buttons{pressed};
  }
  return std::nullopt;
}

}  // namespace vitreo::spacemouse
