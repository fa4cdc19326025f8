// Stand-in for an instrument of the class USBTMC, from the specification's words and tables, byte
// by byte: it echoes messages, and can be slow, halt, answer in parts or with a wrong tag.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/usb_link.h"

#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace vitreo {

class UsbtmcStandIn final : public UsbPeer, public BulkPeer {
 public:
  using Bytes = std::vector<std::uint8_t>;

  const UsbIdentity& identity() const override { return who; }
  BulkPeer* bulk() override { return this; }

  // USBTMC 1.0, 3.2: MsgID, bTag, ~bTag, 0, TransferSize, attributes; filled up to four bytes.
  bool take(std::span<const std::uint8_t> transfer) override {
    if (halted || transfer.size() < 12 || (transfer[1] ^ transfer[2]) != 0xFF || transfer[3] != 0)
      return !(halted = true);
    const std::size_t size = transfer[4] | transfer[5] << 8 | transfer[6] << 16 |
                             static_cast<std::size_t>(transfer[7]) << 24;
    tags.push_back(transfer[1]);
    if (transfer[0] == 1) {
      if (transfer.size() != (12 + size + 3) / 4 * 4) return !(halted = true);
      if (requested) return !(halted = true);  // a read was not ended before
      coming.insert(coming.end(), transfer.begin() + 12,
                    transfer.begin() + 12 + static_cast<std::ptrdiff_t>(size));
      if ((transfer[8] & 1) == 0) return true;
      heard.push_back(coming);
      output.push_back(coming);
      coming.clear();
      return true;
    }
    if (transfer[0] != 2 || transfer.size() != 12) return !(halted = true);
    requested = transfer[1];
    requested_size = size;
    return true;
  }

  // 3.3: the header repeats the request's tag; EOM with the last byte of the message.
  std::optional<Bytes> give() override {
    if (drain_packets > 0) {
      --drain_packets;
      return Bytes(5, 0xEE);
    }
    if (!requested || output.empty() || silent) return std::nullopt;
    Bytes& message = output.front();
    const std::size_t size = std::min({message.size(), requested_size, most_at_once});
    const bool last = size == message.size();
    const auto tag = static_cast<std::uint8_t>(wrong_tag ? *requested + 1 : *requested);
    Bytes transfer{2, tag, static_cast<std::uint8_t>(~tag), 0};
    for (const int shift : {0, 8, 16, 24})
      transfer.push_back(static_cast<std::uint8_t>(size >> shift & 0xFF));
    transfer.insert(transfer.end(), {static_cast<std::uint8_t>(last ? 1 : 0), 0, 0, 0});
    transfer.insert(transfer.end(), message.begin(),
                    message.begin() + static_cast<std::ptrdiff_t>(size));
    if (fills_up) transfer.resize((transfer.size() + 3) / 4 * 4);
    message.erase(message.begin(), message.begin() + static_cast<std::ptrdiff_t>(size));
    if (last) output.pop_front();
    requested.reset();
    return transfer;
  }

  // Table 15; the answers' forms are in 4.2.1.
  std::optional<Bytes> control(const UsbSetup& setup, std::span<const std::uint8_t>,
                               std::uint16_t) override {
    requests.push_back(setup.request);
    if (setup.type == 0x02 && setup.request == 1) {  // CLEAR_FEATURE of an endpoint
      halted = false;
      return Bytes{};
    }
    if (setup.type != 0xA1 && setup.type != 0xA2) return std::nullopt;
    switch (setup.request) {
      case 1:  // INITIATE_ABORT_BULK_OUT
        coming.clear();
        return Bytes{1, static_cast<std::uint8_t>(setup.value)};
      case 2:
        return Bytes{1, 0, 0, 0, 0, 0, 0, 0};
      case 3:  // INITIATE_ABORT_BULK_IN: only of the tag that is in progress
        if (!requested) return Bytes{0x80, 0};
        if (setup.value != *requested) return Bytes{0x81, *requested};
        requested.reset();
        drain_packets = 1;
        return Bytes{1, static_cast<std::uint8_t>(setup.value)};
      case 4:
        return Bytes{static_cast<std::uint8_t>(pendings-- > 0 ? 2 : 1), 0, 0, 0, 0, 0, 0, 0};
      case 5:  // INITIATE_CLEAR
        if (refuses_clear) return Bytes{0x80};
        coming.clear();
        output.clear();
        requested.reset();
        halted = true;  // Bulk-OUT is halted until the host clears it (4.2.1.6)
        return Bytes{1};
      case 6:
        return Bytes{static_cast<std::uint8_t>(pendings-- > 0 ? 2 : 1), 0};
      default:
        return std::nullopt;
    }
  }

  UsbIdentity who{0x1BFA, 0x0498, 0x0100, "0417", "Metrolab", "THM1176", ""};
  std::size_t most_at_once = 1 << 20;
  bool fills_up = true;
  bool wrong_tag = false;
  bool silent = false;
  bool refuses_clear = false;
  int pendings = 0;       // how often a check answers that it is not done
  int drain_packets = 0;  // what is left in Bulk-IN
  bool halted = false;
  std::vector<Bytes> heard;
  std::vector<std::uint8_t> tags;
  std::vector<int> requests;
  std::deque<Bytes> output;

 private:
  Bytes coming;
  std::optional<std::uint8_t> requested;
  std::size_t requested_size = 0;
};

}  // namespace vitreo
