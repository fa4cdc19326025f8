// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/checksum.h"

#include <cstdint>

namespace vitreo::scripted {
namespace {

// Bit by bit and without a table: messages are short, and the polynomial stays readable. Reflected,
// as the line sends the low bit first: 0xA001 is 0x8005 mirrored.
std::uint16_t crc_modbus(std::string_view message) {
  std::uint16_t crc = 0xFFFF;
  for (const char c : message) {
    crc = static_cast<std::uint16_t>(crc ^ static_cast<std::uint8_t>(c));
    for (int bit = 0; bit < 8; ++bit)
      crc = static_cast<std::uint16_t>((crc & 1) != 0 ? (crc >> 1) ^ 0xA001 : crc >> 1);
  }
  return crc;
}

// Not reflected: the high bit first, as x^16 + x^12 + x^5 + 1 is written.
std::uint16_t crc_xmodem(std::string_view message) {
  std::uint16_t crc = 0;
  for (const char c : message) {
    crc = static_cast<std::uint16_t>(crc ^ (static_cast<std::uint8_t>(c) << 8));
    for (int bit = 0; bit < 8; ++bit)
      crc = static_cast<std::uint16_t>((crc & 0x8000) != 0 ? (crc << 1) ^ 0x1021 : crc << 1);
  }
  return crc;
}

}  // namespace

std::size_t checksum_size(Checksum kind) {
  if (kind == Checksum::none) return 0;
  return kind == Checksum::crc16_modbus || kind == Checksum::crc16_xmodem ? 2 : 1;
}

std::string checksum_of(Checksum kind, std::string_view message) {
  std::uint8_t sum = 0, parity = 0;
  for (const char c : message) {
    sum = static_cast<std::uint8_t>(sum + static_cast<std::uint8_t>(c));
    parity = static_cast<std::uint8_t>(parity ^ static_cast<std::uint8_t>(c));
  }
  const auto byte = [](int value) { return static_cast<char>(value & 0xFF); };
  switch (kind) {
    case Checksum::sum8:
      return {byte(sum)};
    case Checksum::xor8:
      return {byte(parity)};
    case Checksum::lrc:
      // Modulo 256 the whole message with its checksum sums up to 0.
      return {byte(-sum)};
    case Checksum::crc16_modbus: {
      const std::uint16_t crc = crc_modbus(message);
      return {byte(crc), byte(crc >> 8)};
    }
    case Checksum::crc16_xmodem: {
      const std::uint16_t crc = crc_xmodem(message);
      return {byte(crc >> 8), byte(crc)};
    }
    case Checksum::none:
      break;
  }
  return {};
}

}  // namespace vitreo::scripted
