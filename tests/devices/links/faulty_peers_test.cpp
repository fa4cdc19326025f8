// Faults on the instrument's side of a wire, each against an instrument that answers what it hears.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/faulty_peers.h"

#include "tests/devices/links/echo_peer.h"

#include <gtest/gtest.h>

#include <memory>
#include <optional>
#include <span>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Report = std::vector<std::uint8_t>;

struct FaultyLine : ::testing::Test {
  /// What comes back by then of what is sent now.
  ByteString asked(std::string_view question, Time now, Time by) {
    line.receive(bytes(question), now);
    return said(by);
  }
  ByteString said(Time by) {
    ByteString all;
    for (const TimedBytes& part : line.say(by))
      all.insert(all.end(), part.bytes.begin(), part.bytes.end());
    return all;
  }
  std::shared_ptr<EchoPeer> instrument = std::make_shared<EchoPeer>(2ms);
  FaultyBytePeer line{instrument};
};

TEST_F(FaultyLine, WithoutAFaultChangesNothing) {
  EXPECT_FALSE(line.touched());
  line.receive(bytes("abc"), 0ms);
  EXPECT_TRUE(line.touched());
  EXPECT_EQ(line.next(), 2ms);
  EXPECT_EQ(said(1ms), bytes(""));
  EXPECT_EQ(said(2ms), bytes("abc"));
}

TEST_F(FaultyLine, SilentIsHeardAndDeafIsNot) {
  line.faults().silent = true;
  EXPECT_EQ(asked("on", 0ms, 5ms), bytes(""));
  EXPECT_EQ(instrument->heard, bytes("on")) << "it obeys";
  line.faults().silent = false;
  line.faults().deaf = true;
  EXPECT_EQ(asked("off", 10ms, 15ms), bytes(""));
  EXPECT_EQ(instrument->heard, bytes("on"));
  line.faults().deaf = false;
  EXPECT_EQ(asked("x", 20ms, 25ms), bytes("x")) << "what was lost does not come later";
}

TEST_F(FaultyLine, EachAnswerIsGarbledOrCutShortAnew) {
  line.faults().garble = 1;
  for (const Time now : {0ms, 10ms}) EXPECT_EQ(asked("abc", now, now + 5ms), bytes("awc"));
  line.faults().garble = -1;
  line.faults().keep = 2;
  for (const Time now : {20ms, 30ms}) EXPECT_EQ(asked("abc", now, now + 5ms), bytes("ab"));
}

TEST_F(FaultyLine, WhatIsLateKeepsItsOrder) {
  line.faults().late = 100ms;
  EXPECT_EQ(asked("slow", 0ms, 101ms), bytes(""));
  EXPECT_EQ(line.next(), 102ms);
  line.faults().late = 0ms;
  EXPECT_EQ(asked("fast", 50ms, 60ms), bytes(""));
  EXPECT_EQ(said(102ms), bytes("slowfast"));
}

TEST_F(FaultyLine, AnEchoComesBeforeTheAnswer) {
  line.faults().echo = true;
  EXPECT_EQ(asked("abc", 0ms, 1ms), bytes("abc"));
  EXPECT_EQ(said(2ms), bytes("abc"));
}

TEST_F(FaultyLine, WithoutPowerItNeitherHearsNorSays) {
  line.receive(bytes("before"), 0ms);
  line.faults().off = true;
  line.faults().echo = true;
  EXPECT_EQ(asked("during", 1ms, 5ms), bytes(""));
  EXPECT_EQ(instrument->heard, bytes("before"));
}

TEST_F(FaultyLine, ExchangedLinesHaveEachOthersInstrument) {
  const auto other_instrument = std::make_shared<EchoPeer>();
  FaultyBytePeer other(other_instrument);
  line.exchange(other);
  line.receive(bytes("a"), 0ms);
  EXPECT_EQ(other_instrument->heard, bytes("a"));
  EXPECT_TRUE(instrument->heard.empty());
}

/// Answers a report with itself.
struct Mirror final : HidPeer {
  std::vector<Report> receive(std::span<const std::uint8_t> report) override {
    heard.emplace_back(report.begin(), report.end());
    return {heard.back()};
  }
  void connect(const Send& to) override { send = to; }
  void power_cycle() override { ++cycles; }
  std::vector<Report> heard;
  Send send;
  int cycles = 0;
};

struct FaultyHid : ::testing::Test {
  FaultyHid() {
    faulty.connect([this](Report report) { unasked.push_back(std::move(report)); });
  }
  std::unique_ptr<Clock> clock = virtual_clock();
  Mirror mirror;
  FaultyHidPeer faulty{mirror, *clock};
  std::vector<Report> unasked;
};

TEST_F(FaultyHid, PassesReportsBothWaysAndSpoilsThem) {
  EXPECT_EQ(faulty.receive(Report{1, 2}), (std::vector<Report>{{1, 2}}));
  EXPECT_TRUE(faulty.touched());
  faulty.faults().garble = 0;
  EXPECT_EQ(faulty.receive(Report{1, 2}), (std::vector<Report>{{1 ^ 0x15, 2}}));
  faulty.faults().garble = -1;
  faulty.faults().keep = 1;
  mirror.send({7, 8});
  EXPECT_EQ(unasked, (std::vector<Report>{{7}}));
}

TEST_F(FaultyHid, SilentIsHeardAndDeafIsNot) {
  faulty.faults().silent = true;
  EXPECT_TRUE(faulty.receive(Report{1}).empty());
  mirror.send({2});
  EXPECT_TRUE(unasked.empty());
  faulty.faults().deaf = true;
  faulty.receive(Report{3});
  EXPECT_EQ(mirror.heard, (std::vector<Report>{{1}}));
}

TEST_F(FaultyHid, LateReportsAreSentWhenTheirTimeHasCome) {
  faulty.faults().late = 80ms;
  EXPECT_TRUE(faulty.receive(Report{1}).empty());
  clock->sleep_for(79ms);
  faulty.serve();
  EXPECT_TRUE(unasked.empty());
  faulty.faults().late = 0ms;
  EXPECT_TRUE(faulty.receive(Report{2}).empty()) << "behind the late one";
  clock->sleep_for(1ms);
  faulty.serve();
  EXPECT_EQ(unasked, (std::vector<Report>{{1}, {2}}));
  faulty.power_cycle();
  EXPECT_EQ(mirror.cycles, 1);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
