// SPDX-License-Identifier: Apache-2.0
#include "devices/links/usbtmc_frames.h"

namespace vitreo::usbtmc {

// Little-endian; byte 8 is bmTransferAttributes.
ByteString to_bytes(const Header& header) {
  ByteString bytes{header.id, header.tag, static_cast<std::uint8_t>(~header.tag), 0};
  for (const int shift : {0, 8, 16, 24})
    bytes.push_back(static_cast<std::uint8_t>(header.size >> shift & 0xFF));
  bytes.push_back(header.end ? 1 : 0);
  bytes.resize(kHeader);
  return bytes;
}

std::optional<Header> parse_header(std::span<const std::uint8_t> transfer) {
  if (transfer.size() < kHeader || transfer[1] == 0 ||
      transfer[2] != static_cast<std::uint8_t>(~transfer[1]))
    return std::nullopt;
  std::uint32_t size = 0;
  for (const std::size_t at : {7, 6, 5, 4}) size = size << 8 | transfer[at];
  return Header{transfer[0], transfer[1], size, (transfer[8] & 1) != 0};
}

ByteString message_out(std::uint8_t tag, std::span<const std::uint8_t> part, bool end) {
  ByteString bytes = to_bytes({dev_dep_msg_out, tag, static_cast<std::uint32_t>(part.size()), end});
  bytes.insert(bytes.end(), part.begin(), part.end());
  bytes.resize((bytes.size() + 3) / 4 * 4);
  return bytes;
}

ByteString request_in(std::uint8_t tag, std::uint32_t size) {
  return to_bytes({request_dev_dep_msg_in, tag, size, false});
}

std::uint8_t next_tag(std::uint8_t tag) {
  return tag == 255 ? std::uint8_t{1} : static_cast<std::uint8_t>(tag + 1);
}

UsbSetup to_endpoint(Request request, std::uint8_t endpoint, std::uint8_t tag) {
  return {0xA2, static_cast<std::uint8_t>(request), tag, endpoint};
}
UsbSetup to_interface(Request request, std::uint8_t interface) {
  return {0xA1, static_cast<std::uint8_t>(request), 0, interface};
}

}  // namespace vitreo::usbtmc
