// Wire of foot pedals: input reports encoded and decoded; no I/O. The layout differs from maker to
// maker, so it is data.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace vitreo::foot_pedal {

using Bytes = std::span<const std::uint8_t>;
using Report = std::vector<std::uint8_t>;

/// Byte and bit of one pedal in a report.
struct Pedal {
  std::size_t byte = 0;
  std::uint8_t mask = 1;
};
struct Layout {
  std::size_t size = 2;       ///< bytes of a report; a shorter one is foreign
  std::vector<Pedal> pedals;  ///< left to right
  /// Its first byte is constant, and may be the number that Windows puts before a report without
  /// one: a report that is a byte shorter is the same without it.
  bool constant_first = false;
};

/// X-keys foot pedal, 05f3:0268: 19 bytes, the first one constant (X-keys SDK, which counts bits
/// from 1).
inline Layout xkeys_xk3() { return {19, {{1, 0x02}, {1, 0x04}, {1, 0x08}}, true}; }
/// X-keys XK-3 as it is sold, 05f3:0438 (also 0439, 043a, 04e8): unit id, type, pedals, ... (X-keys
/// SDK; SuperFlyTV/xkeys reads it through hidraw).
inline Layout xkeys_xk3_0438() { return {32, {{2, 0x02}, {2, 0x04}, {2, 0x08}}}; }
/// VEC Infinity, 05f3:00ff: two bytes, by its HID descriptor.
inline Layout infinity() { return {2, {{0, 0x01}, {0, 0x02}, {0, 0x04}}}; }

/// A bit for each pedal that is down, the left one in bit 0; nothing for a report that is cut
/// short.
inline std::optional<std::uint32_t> decode(Bytes report, const Layout& layout) {
  const std::size_t missing = layout.constant_first && report.size() == layout.size - 1 ? 1 : 0;
  if (report.size() + missing < layout.size) return std::nullopt;
  std::uint32_t down = 0;
  for (std::size_t i = 0; i < layout.pedals.size(); ++i)
    if ((report[layout.pedals[i].byte - missing] & layout.pedals[i].mask) != 0) down |= 1U << i;
  return down;
}
inline Report encode(std::uint32_t down, const Layout& layout) {
  Report report(layout.size, 0);
  for (std::size_t i = 0; i < layout.pedals.size(); ++i)
    if ((down >> i & 1U) != 0) report[layout.pedals[i].byte] |= layout.pedals[i].mask;
  return report;
}

}  // namespace vitreo::foot_pedal
