// SPDX-License-Identifier: Apache-2.0
#include "host/terminal_text.h"

#include "host/progress_line.h"

#include <fmt/format.h>

namespace vitreo {

std::string for_terminal(const std::string& text, std::size_t most) {
  if (text.size() <= most) return harmless(text);
  while (most > 0 && (static_cast<unsigned char>(text[most]) & 0xC0) == 0x80) --most;  // no half of a letter
  return harmless(text.substr(0, most)) + fmt::format(" ... ({} characters)", text.size());
}

}  // namespace vitreo
