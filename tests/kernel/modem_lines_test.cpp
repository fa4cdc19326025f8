// RTS and DTR of a serial adapter while a port is opened, held and closed, as the adapter itself
// sees them: the kernel raises both by itself, boards restart by DTR, and a heartbeat line is RTS.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/modem_lines.h"

#include "devices/links/serial_link.h"
#include "tests/kernel/guest.h"

#include <gtest/gtest.h>

#include <vector>

namespace vitreo::kernel_guest {
namespace {

class ModemLinesGuest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    load({"vhci-hcd", "ftdi_sio"});
    adapter = std::make_unique<Gadget>(
        std::vector<std::string>{"usbip", "ftdi_adapter", "--option", "serial=LINES"});
    node = adapter_node("LINES");
  }
  static void TearDownTestSuite() { adapter.reset(); }
  void SetUp() override { seen_ = history().size(); }

  struct Change {
    double at;  // s
    std::string line;
    bool asserted;
  };
  /// Of both lines since the case began.
  std::vector<Change> changes() {
    const nlohmann::json all = history();
    std::vector<Change> found;
    for (std::size_t i = seen_; i < all.size(); ++i)
      if (all[i][1] == "rts" || all[i][1] == "dtr")
        found.push_back(
            {all[i][0].get<double>(), all[i][1].get<std::string>(), all[i][2].get<int>() != 0});
    return found;
  }
  /// "rts+ dtr+ rts-": in their order.
  std::string told() {
    std::string text;
    for (const Change& one : changes()) text += one.line + (one.asserted ? "+ " : "- ");
    return text.empty() ? text : text.substr(0, text.size() - 1);
  }
  bool asserted(const std::string& line) { return adapter->state(line).get<int>() != 0; }
  std::unique_ptr<ByteLink> open(OpeningLines lines, bool rts_cts = false) {
    SerialSettings settings;
    settings.opening_lines = lines;
    settings.rts_cts = rts_cts;
    return open_serial(node, settings, *clock);
  }

  static std::unique_ptr<Gadget> adapter;
  static std::string node;
  const std::unique_ptr<Clock> clock = wall_clock();

 private:
  static nlohmann::json history() { return adapter->order({{"history", true}}).at("history"); }
  std::size_t seen_ = 0;
};
std::unique_ptr<Gadget> ModemLinesGuest::adapter;
std::string ModemLinesGuest::node;

TEST_F(ModemLinesGuest, AreAssertedWhileAPortIsOpenAndFallWithItsClose) {
  for (const bool rts_cts : {false, true}) {
    auto link = open(OpeningLines::asserted, rts_cts);
    EXPECT_TRUE(asserted("rts"));
    EXPECT_TRUE(asserted("dtr"));
    link.reset();
    EXPECT_FALSE(asserted("rts"));
    EXPECT_FALSE(asserted("dtr"));
  }
  row("opened and closed, twice: %s", told().c_str());
  EXPECT_EQ(changes().size(), 8U) << "once up and once down each: " << told();
}

// The moment that the kernel makes cannot be kept from a board: docs/links.md.
TEST_F(ModemLinesGuest, AreReleasedAfterTheKernelHasRaisedThemForAMoment) {
  const auto link = open(OpeningLines::released);
  EXPECT_FALSE(asserted("rts"));
  EXPECT_FALSE(asserted("dtr"));
  const std::vector<Change> seen = changes();
  ASSERT_EQ(seen.size(), 4U) << told();
  const double moment = (seen[3].at - seen[0].at) * 1e3;
  row("released: %s, up for %.1f ms", told().c_str(), moment);
  EXPECT_LT(moment, 50);
}

/// ms between the line's going to that level and its leaving it again.
template <class Changes>
double kept(const Changes& seen, const std::string& line, bool level) {
  double since = -1;
  for (const auto& one : seen) {
    if (one.line != line) continue;
    if (one.asserted == level)
      since = one.at;
    else if (since >= 0)
      return (one.at - since) * 1e3;
  }
  return -1;
}

TEST_F(ModemLinesGuest, APulseOfRtsIsAHundredMillisecondsWithDtrHeld) {
  const auto link = open(OpeningLines::rts_pulse);
  EXPECT_FALSE(asserted("rts"));
  EXPECT_TRUE(asserted("dtr"));
  const double up = kept(changes(), "rts", true);
  row("rts_pulse: %s, RTS up for %.1f ms", told().c_str(), up);
  EXPECT_GE(up, 100);  // 50, flush, 50: APT protocol, section 1.1
  EXPECT_LT(up, 150);
}

TEST_F(ModemLinesGuest, APulseOfDtrIsFiftyMillisecondsAndLeavesBothAsserted) {
  const auto link = open(OpeningLines::dtr_pulse);
  EXPECT_TRUE(asserted("rts"));
  EXPECT_TRUE(asserted("dtr"));
  const double down = kept(changes(), "dtr", false);
  row("dtr_pulse: %s, DTR down for %.1f ms", told().c_str(), down);
  EXPECT_GE(down, 50);
  EXPECT_LT(down, 100);
}

// One edge, of the kernel's own: a relay with an on-delay longer than the pulse takes it for none.
TEST_F(ModemLinesGuest, OfAHeartbeatLineFallAtItsOpeningAndFollowOneByOne) {
  auto lines = open_modem_lines(node, *clock);
  EXPECT_FALSE(asserted("rts"));
  EXPECT_FALSE(asserted("dtr"));
  lines->set(ModemLine::rts, true);
  EXPECT_TRUE(asserted("rts"));
  EXPECT_FALSE(asserted("dtr")) << "the other line is left alone";
  lines.reset();
  EXPECT_FALSE(asserted("rts")) << "with its last close, however that comes";
  row("heartbeat line: %s", told().c_str());
}

}  // namespace
}  // namespace vitreo::kernel_guest
