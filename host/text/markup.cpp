// SPDX-License-Identifier: Apache-2.0
#include "host/text/markup.h"

#include <cstdint>

namespace vitreo {
namespace {

constexpr std::string_view kReplacement = "\uFFFD";  // REPLACEMENT CHARACTER

/// The length of the valid UTF-8 sequence at the start of `text` that XML allows; 0 when there is
/// none.
std::size_t sequence_length(std::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char lead = byte(0);
  if (lead < 0x80) return lead >= 0x20 && lead != 0x7F ? 1 : 0;
  const std::size_t length = lead >= 0xF0 ? 4 : lead >= 0xE0 ? 3 : 2;
  // RFC 3629: 0xC0 and 0xC1 would be overlong, 0xF5 and above beyond U+10FFFF; 0x80 to 0xC1 are no
  // lead bytes.
  // Before the sequence is read: a text that ends within one must not be read beyond its end.
  if (lead < 0xC2 || lead > 0xF4 || text.size() < length) return 0;
  std::uint32_t code = lead & (0xFF >> (length + 1));
  for (std::size_t i = 1; i < length; ++i) {
    if ((byte(i) & 0xC0) != 0x80) return 0;
    code = code << 6 | (byte(i) & 0x3F);
  }
  // Overlong forms, surrogates and the two noncharacters that XML 1.0 excludes (2.2) are refused.
  // By the length of the sequence.
  constexpr std::uint32_t kSmallest[] = {0, 0, 0x80, 0x800, 0x10000};
  const bool surrogate = code >= 0xD800 && code <= 0xDFFF;
  const bool is_character = code <= 0x10FFFF && code != 0xFFFE && code != 0xFFFF;
  return code >= kSmallest[length] && !surrogate && is_character ? length : 0;
}

}  // namespace

// XML 1.0, 2.4: the five predefined entities. One byte of what is no character at a time becomes a
// replacement, so that the text after it is kept.
std::string escape_markup(std::string_view text) {
  std::string out;
  out.reserve(text.size() + text.size() / 8);
  while (!text.empty()) {
    const char c = text.front();
    const std::size_t length = c == '\n' || c == '\t' ? 1 : sequence_length(text);
    if (length == 0) {
      out += kReplacement;
    } else if (c == '&') {
      out += "&amp;";
    } else if (c == '<') {
      out += "&lt;";
    } else if (c == '>') {
      out += "&gt;";
    } else if (c == '"') {
      out += "&quot;";
    } else if (c == '\'') {
      out += "&#39;";
    } else {
      out += text.substr(0, length);
    }
    text.remove_prefix(length == 0 ? 1 : length);
  }
  return out;
}

// Code points: every byte but the continuation bytes 10xxxxxx.
std::size_t count_characters(std::string_view text) {
  std::size_t count = 0;
  for (char c : text) count += (static_cast<unsigned char>(c) & 0xC0) != 0x80;
  return count;
}

// Cut at the lead byte of the next character, so that no sequence is torn.
std::string_view first_characters(std::string_view text, std::size_t count) {
  std::size_t seen = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if ((static_cast<unsigned char>(text[i]) & 0xC0) == 0x80) continue;
    if (seen++ == count) return text.substr(0, i);
  }
  return text;
}

// RFC 4648, section 4, with padding.
// Three bytes make four digits of six bits; missing bytes of the last group are marked by '='.
// The text has its length from the begin, for an image's has megabytes.
std::string base64(std::span<const unsigned char> bytes) {
  constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out((bytes.size() + 2) / 3 * 4, '=');
  char* at = out.data();
  const std::size_t whole = bytes.size() / 3 * 3;
  for (std::size_t i = 0; i < whole; i += 3) {
    const std::uint32_t group = std::uint32_t{bytes[i]} << 16 | std::uint32_t{bytes[i + 1]} << 8 |
                                std::uint32_t{bytes[i + 2]};
    *at++ = kDigits[group >> 18];
    *at++ = kDigits[group >> 12 & 63];
    *at++ = kDigits[group >> 6 & 63];
    *at++ = kDigits[group & 63];
  }
  if (whole == bytes.size()) return out;
  std::uint32_t rest = std::uint32_t{bytes[whole]} << 16;
  if (whole + 1 < bytes.size()) rest |= std::uint32_t{bytes[whole + 1]} << 8;
  *at++ = kDigits[rest >> 18];
  *at++ = kDigits[rest >> 12 & 63];
  if (whole + 1 < bytes.size()) *at = kDigits[rest >> 6 & 63];
  return out;
}

}  // namespace vitreo
