// SPDX-License-Identifier: Apache-2.0
#include "tests/devices/firewire/rom.h"

#include <string>

namespace vitreo {
namespace {

constexpr std::uint32_t kTradeAssociation = 0x00A02D;  // Unit_Spec_ID of IIDC
constexpr std::uint32_t kVersion130 = 0x000102;        // Unit_SW_Version from IIDC 1.30 on
constexpr std::uint32_t kRegisters = 0xF00000;         // of the camera, from FFFF F000 0000

std::uint32_t entry(std::uint32_t key, std::uint32_t value) { return key << 24 | value; }
std::uint32_t header(std::size_t quadlets) { return static_cast<std::uint32_t>(quadlets) << 16; }

/// A textual leaf: two quadlets that say minimal ASCII, then the letters.
std::vector<std::uint32_t> leaf(const std::string& text) {
  std::vector<std::uint32_t> quadlets{0, 0, 0};
  for (std::size_t i = 0; i < text.size(); i += 4) {
    std::uint32_t four = 0;
    for (std::size_t k = 0; k < 4; ++k)
      four = four << 8 | (i + k < text.size() ? static_cast<unsigned char>(text[i + k]) : 0U);
    quadlets.push_back(four);
  }
  quadlets[0] = header(quadlets.size() - 1);
  return quadlets;
}

}  // namespace

std::vector<std::uint32_t> configuration_rom(const FireWireCamera& camera) {
  const auto high = static_cast<std::uint32_t>(camera.guid >> 32);
  const auto low = static_cast<std::uint32_t>(camera.guid);
  std::vector<std::uint32_t> rom{0x04040000, 0x31333934, 0x0000A002, high, low};
  // Root directory: vendor, capabilities, and the unit directory right behind it.
  rom.insert(rom.end(), {header(3), entry(0x03, high >> 8), entry(0x0C, 0x0083C0), entry(0xD1, 1)});
  // Unit directory, with the unit dependent directory behind it.
  rom.insert(rom.end(),
             {header(3), entry(0x12, kTradeAssociation), entry(0x13, kVersion130), entry(0xD4, 1)});
  const std::vector<std::uint32_t> vendor = leaf(camera.vendor);
  const std::vector<std::uint32_t> model = leaf(camera.model);
  // Offsets of leaves count from their own entry.
  rom.insert(rom.end(),
             {header(4), entry(0x40, kRegisters / 4), entry(0x38, camera.sub_version),
              entry(0x81, 2), entry(0x82, 1 + static_cast<std::uint32_t>(vendor.size()))});
  rom.insert(rom.end(), vendor.begin(), vendor.end());
  rom.insert(rom.end(), model.begin(), model.end());
  return rom;
}

}  // namespace vitreo
