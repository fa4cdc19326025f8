// SPDX-License-Identifier: Apache-2.0
#include "devices/links/printable.h"

#include <algorithm>
#include <array>
#include <cstdio>

namespace vitreo {

std::string printable(std::span<const std::uint8_t> bytes, std::size_t most) {
  std::string text;
  for (const std::uint8_t byte : bytes.first(std::min(bytes.size(), most))) {
    if (byte >= 0x20 && byte < 0x7F) {
      text.push_back(static_cast<char>(byte));
      continue;
    }
    std::array<char, 5> hex{};
    std::snprintf(hex.data(), hex.size(), "\\x%02X", byte);
    text += hex.data();
  }
  return bytes.size() > most ? text + "..." : text;
}

std::string printable(std::string_view text, std::size_t most) {
  return printable(std::span(reinterpret_cast<const std::uint8_t*>(text.data()), text.size()),
                   most);
}

}  // namespace vitreo
