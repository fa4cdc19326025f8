// Untrusted text made harmless for a terminal: no control characters, no escape sequences.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>

namespace vitreo {

/// `text` with the controls of terminals written out: what a script says may not steer the screen.
std::string harmless(const std::string& text);

/// Harmless, and of at most `most` bytes of the text; then how many bytes there were. The record
/// has them all.
std::string for_terminal(const std::string& text, std::size_t most = 2000);

/// The beginning of UTF-8 that has at most `most` bytes and ends with a whole character.
std::string whole_characters(const std::string& text, std::size_t most);

/// Columns in which a terminal shows UTF-8 without control characters: two for a wide character,
/// none for an accent of its own.
std::size_t columns_of(const std::string& text);
/// The beginning of `text` that takes at most `columns`.
std::string first_columns(const std::string& text, std::size_t columns);

}  // namespace vitreo
