// Checksums of messages.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace vitreo::scripted {

enum class Checksum { none, sum8, xor8, lrc, crc16_modbus, crc16_xmodem };

/// The bytes that follow `message`: one of sum8 (the sum modulo 256), xor8, lrc (two's complement
/// of the sum); two of crc16_modbus (polynomial 0xA001 reflected, begins with 0xFFFF, low byte
/// first) and crc16_xmodem (0x1021, begins with 0, high byte first). Catalogue of parametrised CRC
/// algorithms: CRC-16/MODBUS, CRC-16/XMODEM.
std::string checksum_of(Checksum kind, std::string_view message);
std::size_t checksum_size(Checksum kind);

}  // namespace vitreo::scripted
