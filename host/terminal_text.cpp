// SPDX-License-Identifier: Apache-2.0
#include "host/terminal_text.h"

#include <fmt/format.h>

namespace vitreo {

std::string harmless(const std::string& text) {
  std::string out;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    out += (byte < 0x20 && c != '\n' && c != '\t') || byte == 0x7F ? fmt::format("\\x{:02x}", byte) : std::string(1, c);
  }
  return out;
}

std::string for_terminal(const std::string& text, std::size_t most) {
  if (text.size() <= most) return harmless(text);
  while (most > 0 && (static_cast<unsigned char>(text[most]) & 0xC0) == 0x80) --most;  // no half of a letter
  return harmless(text.substr(0, most)) + fmt::format(" ... ({} characters)", text.size());
}

}  // namespace vitreo
