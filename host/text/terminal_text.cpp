// SPDX-License-Identifier: Apache-2.0
#include "host/text/terminal_text.h"

#include <fmt/format.h>

namespace vitreo {

// C0 and C1 control characters and DEL can move the cursor, set colors or answer on the terminal's
// input: they are shown as escapes. New lines and tabs stay.
std::string harmless(const std::string& text) {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto byte = static_cast<unsigned char>(text[i]);
    const bool c1 = byte == 0xC2 && i + 1 < text.size() &&
                    (static_cast<unsigned char>(text[i + 1]) & 0xE0) == 0x80;
    if ((byte < 0x20 && byte != '\n' && byte != '\t') || byte == 0x7F)
      out += fmt::format("\\x{:02x}", byte);
    else if (c1)  // U+0080 to U+009F, among them a CSI of one character
      out += fmt::format("\\u{:04x}", static_cast<unsigned char>(text[++i]));
    else
      out += text[i];
  }
  return out;
}

// Shortened before it is escaped: `most` bounds the work too, for a text of a script may be of any
// length.
std::string for_terminal(const std::string& text, std::size_t most) {
  if (text.size() <= most) return harmless(text);
  // Back to the start of a UTF-8 sequence.
  while (most > 0 && (static_cast<unsigned char>(text[most]) & 0xC0) == 0x80) --most;
  return harmless(text.substr(0, most)) + fmt::format(" ... ({} characters)", text.size());
}

}  // namespace vitreo
