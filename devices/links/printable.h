// Printable text of bytes that came from a device: control characters must not reach a terminal.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace vitreo {

/// Printable characters as they are, others as \xNN; cut after `most` bytes, with "..." behind.
std::string printable(std::span<const std::uint8_t> bytes, std::size_t most = 40);
std::string printable(std::string_view text, std::size_t most = 40);

}  // namespace vitreo
