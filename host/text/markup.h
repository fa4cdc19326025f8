// Escaping of text and bytes for SVG and HTML.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>
#include <string_view>

namespace vitreo {

/// Well-formed character data, whatever a script wrote: &<>"' escaped; broken UTF-8 and control
/// characters replaced.
std::string escape_markup(std::string_view text);

/// How many characters a UTF-8 text has, and its first `count` characters.
std::size_t count_characters(std::string_view text);
std::string_view first_characters(std::string_view text, std::size_t count);

std::string base64(std::span<const unsigned char> bytes);

}  // namespace vitreo
