// Sniffer on a wire: how many bytes went either way, and when, for tests that count a line's time
// by hand.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/links/hid_link.h"
#include "devices/links/usb_link.h"

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace vitreo {

/// Stands before an emulator. Bytes of the host are counted as they arrive, those of the emulator
/// as they leave it.
struct ByteSniffer final : BytePeer {
  explicit ByteSniffer(BytePeer& its_peer) : peer(its_peer) {}
  void receive(std::span<const std::uint8_t> bytes, Time now) override {
    if (heard.empty()) first = now;
    heard.append(bytes.begin(), bytes.end());
    peer.receive(bytes, now);
  }
  std::vector<TimedBytes> say(Time now) override {
    std::vector<TimedBytes> said_now = peer.say(now);
    for (const TimedBytes& one : said_now) said.append(one.bytes.begin(), one.bytes.end());
    return said_now;
  }
  Time next() const override { return peer.next(); }
  /// Begins to count anew.
  void clear() {
    heard.clear();
    said.clear();
  }
  /// s, by hand: ten bits a byte, both ways one after the other.
  double seconds(double baud_rate) const {
    return static_cast<double>(heard.size() + said.size()) * 10 / baud_rate;
  }

  BytePeer& peer;
  std::string heard;  // of the host
  std::string said;   // by the emulator
  Time first{};       // when the first byte had arrived
};

/// Before an emulator on HID: counts reports, each a transfer.
struct HidSniffer final : HidPeer {
  explicit HidSniffer(HidPeer& its_peer) : peer(its_peer) {}
  std::vector<std::vector<std::uint8_t>> receive(std::span<const std::uint8_t> report) override {
    auto answers = peer.receive(report);
    transfers += 1 + static_cast<int>(answers.size());
    return answers;
  }
  HidPeer& peer;
  int transfers = 0;
};

/// Before an emulator on USB: counts control transfers.
struct UsbSniffer final : UsbPeer {
  explicit UsbSniffer(UsbPeer& its_peer) : peer(its_peer) {}
  const UsbIdentity& identity() const override { return peer.identity(); }
  std::optional<std::vector<std::uint8_t>> control(const UsbSetup& setup,
                                                   std::span<const std::uint8_t> data,
                                                   std::uint16_t length) override {
    ++transfers;
    return peer.control(setup, data, length);
  }
  UsbPeer& peer;
  int transfers = 0;
};

}  // namespace vitreo
