// CRC-32 (ISO 3309, as in PNG, zip and MCAP): guards each recorded frame.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

namespace vitreo {

/// Goes on from `before`, the CRC-32 of what came before these bytes.
std::uint32_t crc32(const void* bytes, std::size_t size, std::uint32_t before = 0);

}  // namespace vitreo
