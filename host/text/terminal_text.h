// Untrusted text made harmless for a terminal: no control characters, no escape sequences.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>

namespace vitreo {

/// `text` with the controls of terminals written out: what a script says may not steer the screen.
std::string harmless(const std::string& text);

/// Harmless, and of at most `most` bytes of the text; then how many
/// there were. The record has them all.
std::string for_terminal(const std::string& text, std::size_t most = 2000);

}  // namespace vitreo
