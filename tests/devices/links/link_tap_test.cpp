// The tap of the links: every byte of either direction, and when; the link itself stays as it was.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/link_tap.h"

#include "devices/time/error.h"
#include "tests/devices/links/echo_peer.h"

#include <gtest/gtest.h>

#include <optional>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

struct Passed {
  std::string link;
  Time time;
  std::string event;
  ByteString bytes;
  bool operator==(const Passed&) const = default;
};

struct Tape final : LinkTap {
  void passed(const LinkName& link, Time time, LinkEvent event,
              std::span<const std::uint8_t> bytes) override {
    all.push_back({link.role + " " + link.address, time, to_string(event),
                   ByteString(bytes.begin(), bytes.end())});
  }
  std::vector<Passed> all;
};

struct LinkTapTest : ::testing::Test {
  std::unique_ptr<Clock> clock = virtual_clock();
  Tape tape;
};

TEST_F(LinkTapTest, SeesTheBytesOfAByteLinkBothWaysWithTheirTimes) {
  EchoPeer peer(3ms);
  const auto link =
      tapped(memory_byte_link(peer, *clock, {1ms, 0ms}), {"stage", "emulated"}, tape, *clock);
  link->write(bytes("abc"), 1s);
  EXPECT_EQ(link->read(2, 1s), bytes("ab"));
  EXPECT_EQ(link->read(9, 1s), bytes("c"));
  EXPECT_EQ(link->read(9, 1s), ByteString{});  // nothing came: nothing is noted
  EXPECT_EQ(link->address(), "emulated");
  const std::vector<Passed> expected{{"stage emulated", 0ms, "opened", {}},
                                     {"stage emulated", 0ms, "to", bytes("abc")},
                                     {"stage emulated", 5ms, "from", bytes("ab")},
                                     {"stage emulated", 5ms, "from", bytes("c")}};
  EXPECT_EQ(tape.all, expected);
  EXPECT_EQ(peer.heard, bytes("abc"));
}

TEST_F(LinkTapTest, NotesTheEndOfALinkAndItsReturn) {
  EchoPeer peer;
  LinkFaults faults;
  const auto link =
      tapped(memory_byte_link(peer, *clock, {}, &faults), {"stage", "emulated"}, tape, *clock);
  faults.unplugged = true;
  EXPECT_THROW(link->write(bytes("a"), 1s), DeviceError);
  EXPECT_THROW(link->reopen(), DeviceError);
  faults.unplugged = false;
  link->reopen();
  ASSERT_EQ(tape.all.size(), 5U);
  EXPECT_EQ(tape.all[1].event, "to") << "whether it has left is not known, and so it is noted";
  EXPECT_EQ(tape.all[2].event, "failed");
  EXPECT_EQ(tape.all[2].bytes, bytes("emulated: is gone (lost)"));
  EXPECT_EQ(tape.all[3].event, "failed");
  EXPECT_EQ(tape.all[4].event, "opened");
}

struct ReportEcho final : HidPeer {
  std::vector<std::vector<std::uint8_t>> receive(std::span<const std::uint8_t> report) override {
    heard.emplace_back(report.begin(), report.end());
    return {heard.back()};
  }
  std::vector<ByteString> heard;
};

TEST_F(LinkTapTest, SeesReports) {
  ReportEcho peer;
  const auto link =
      tapped(memory_hid_link(peer, *clock, 2ms), {"coils", "hid:09db:009c"}, tape, *clock);
  link->write(ByteString{0x44, 1});
  EXPECT_EQ(link->read(1s), (ByteString{0x44, 1}));
  EXPECT_EQ(link->read(1s), std::nullopt);
  const std::vector<Passed> expected{{"coils hid:09db:009c", 0ms, "opened", {}},
                                     {"coils hid:09db:009c", 0ms, "to", {0x44, 1}},
                                     {"coils hid:09db:009c", 4ms, "from", {0x44, 1}}};
  EXPECT_EQ(tape.all, expected);
}

/// Answers reads by bytes that count, and stalls the request 0x13.
struct Transfers final : UsbPeer {
  const UsbIdentity& identity() const override { return its; }
  std::optional<std::vector<std::uint8_t>> control(const UsbSetup& setup,
                                                   std::span<const std::uint8_t>,
                                                   std::uint16_t length) override {
    if (setup.request == 0x13) return std::nullopt;
    std::vector<std::uint8_t> answer(length);
    for (std::size_t i = 0; i < answer.size(); ++i) answer[i] = static_cast<std::uint8_t>(i);
    return answer;
  }
  UsbIdentity its{0x1FFB, 0x00B3, 0x0100, "1", "Pololu", "Tic", ""};
};

// USB 2.0, table 9-2: bmRequestType, bRequest, wValue, wIndex, wLength, words little-endian.
TEST_F(LinkTapTest, SeesControlTransfersWithTheEightBytesOfTheirSetup) {
  Transfers peer;
  const auto link =
      tapped(memory_usb_link(peer, *clock, 1ms), {"lens_mover", "usb:1ffb:00b3"}, tape, *clock);
  link->write({0x40, 0xE0, 0x1234, 0x0001}, ByteString{9}, 1s);
  EXPECT_EQ(link->read({0xC0, 0xA1, 0, 0x0022}, 3, 1s), (ByteString{0, 1, 2}));
  EXPECT_THROW(link->write({0x40, 0x13, 0, 0}, {}, 1s), DeviceError);
  ASSERT_EQ(tape.all.size(), 6U);
  EXPECT_EQ(tape.all[1].bytes, (ByteString{0x40, 0xE0, 0x34, 0x12, 0x01, 0x00, 0x01, 0x00, 9}));
  EXPECT_EQ(tape.all[2].bytes, (ByteString{0xC0, 0xA1, 0, 0, 0x22, 0, 3, 0}));
  EXPECT_EQ(tape.all[3], (Passed{"lens_mover usb:1ffb:00b3", 2ms, "from", {0, 1, 2}}));
  EXPECT_EQ(tape.all[5].event, "failed");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
