// SPDX-License-Identifier: Apache-2.0
#include "host/text/terminal_text.h"

#include <fmt/format.h>

#include <clocale>
#include <cwchar>

namespace vitreo {
namespace {

/// The C library's widths of characters, of this thread while it lives.
/// By a locale of its own: the program's is "C", whose only characters are ASCII.
class Utf8 {
 public:
  Utf8() : before_(uselocale(locale())) {}
  ~Utf8() { uselocale(before_); }
  Utf8(const Utf8&) = delete;
  Utf8& operator=(const Utf8&) = delete;

  /// Columns of the character at `at`, which moves behind it. A byte that begins none has one.
  std::size_t next(const std::string& text, std::size_t& at) const {
    wchar_t character = 0;
    std::mbstate_t state{};
    const std::size_t size = std::mbrtowc(&character, text.data() + at, text.size() - at, &state);
    const bool whole = size != 0 && size <= text.size() - at;
    at += whole ? size : 1;
    const int width = whole ? wcwidth(character) : 1;
    return width < 0 ? 1 : static_cast<std::size_t>(width);
  }

 private:
  // Never freed: one for the program. Where the system has none, a byte is a column.
  static locale_t locale() {
    static const locale_t utf8 = newlocale(LC_CTYPE_MASK, "C.UTF-8", nullptr);
    return utf8;
  }
  const locale_t before_;
};

}  // namespace

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

std::string whole_characters(const std::string& text, std::size_t most) {
  if (text.size() <= most) return text;
  // Bytes 10xxxxxx continue a character.
  while (most > 0 && (static_cast<unsigned char>(text[most]) & 0xC0) == 0x80) --most;
  return text.substr(0, most);
}

// Shortened before it is escaped: `most` bounds the work too, for a text of a script may be of any
// length.
std::string for_terminal(const std::string& text, std::size_t most) {
  if (text.size() <= most) return harmless(text);
  return harmless(whole_characters(text, most)) + fmt::format(" ... ({} bytes)", text.size());
}

std::size_t columns_of(const std::string& text) {
  std::size_t columns = 0;
  const Utf8 utf8;
  for (std::size_t at = 0; at < text.size();) columns += utf8.next(text, at);
  return columns;
}

std::string first_columns(const std::string& text, std::size_t columns) {
  const Utf8 utf8;
  std::size_t end = 0;
  for (std::size_t at = 0; at < text.size(); end = at) {
    const std::size_t width = utf8.next(text, at);
    if (width > columns) break;
    columns -= width;
  }
  return text.substr(0, end);
}

}  // namespace vitreo
