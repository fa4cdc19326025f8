// Heartbeat line: it beats while everything is alive, and the amplifiers behind its one-shot are
// off when anything is not.
// SPDX-License-Identifier: Apache-2.0
#include "host/safety/heartbeat_line.h"

#include "devices/sim/one_shot.h"
#include "devices/time/error.h"
#include "host/safety/interlock.h"

#include <gtest/gtest.h>

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

/// A line with a one-shot behind it.
class WiredLine : public EnableLine {
 public:
  explicit WiredLine(Clock& clock) : clock_(clock) {}
  std::string identity() const override { return "wired"; }
  void set(bool high) override {
    if (hangs > Time::zero()) clock_.sleep_for(hangs);
    if (broken) throw DeviceError(DeviceErrorKind::lost, "line", "unplugged");
    if (high && !high_) edges.push_back(clock_.now());
    high_ = high;
    relay.input(high, clock_.now());
  }
  bool high() const override { return high_; }
  void make_safe() override { set(false); }
  bool on() { return relay.on(clock_.now()); }

  sim::OneShot relay{70ms};
  std::vector<Time> edges;
  bool broken = false;
  Time hangs{};

 private:
  Clock& clock_;
  bool high_ = false;
};

/// What flows is what is set, where the relay lets it.
class Amplifier : public CoilAmplifier {
 public:
  explicit Amplifier(WiredLine& line) : line_(line) {}
  std::string identity() const override { return "fake"; }
  int channels() const override { return 2; }
  double current_limit() const override { return 10; }
  void set_currents(std::span<const double> currents) override {
    if (currents[0] != 0 && !line_.on()) stepped_while_off = true;
    set.assign(currents.begin(), currents.end());
  }
  std::vector<double> currents() const override { return set; }
  std::optional<std::vector<double>> measured_currents() override { return std::nullopt; }
  LinkState link_state() const override { return links; }
  void make_safe() override {
    if (deaf) throw DeviceError(DeviceErrorKind::lost, "coils", "unplugged");
    set.assign(2, 0);
  }
  double flows() { return line_.on() ? set[0] : 0; }
  std::vector<double> set{0, 0};
  LinkState links;
  bool deaf = false;
  bool stepped_while_off = false;

 private:
  WiredLine& line_;
};

const std::vector<double> kOne{1, 1}, kZero{0, 0};

struct HeartbeatLineTest : testing::Test {
  HeartbeatLineTest() {
    interlock->beat_on(line, {});
    interlock->on_trip([this](const Interlock::Trip& trip) {
      trips.push_back(trip.why);
      broken = trip.broken;
    });
  }
  std::unique_ptr<Clock> clock = virtual_clock();
  WiredLine line{*clock};
  Amplifier amplifier{line};
  InterlockLimits limits{};
  std::vector<std::string> trips;
  bool broken = false;  // the last one: it aborts the run
  std::unique_ptr<Interlock> interlock =
      std::make_unique<Interlock>(amplifier, limits, clock.get());

  /// ms until nothing flows; nothing within half a second.
  std::optional<double> off_after() {
    const Time began = clock->now();
    while (clock->now() - began < 500ms) {
      if (amplifier.flows() == 0) return to_seconds(clock->now() - began) * 1e3;
      clock->sleep_for(1ms);
    }
    return std::nullopt;
  }
  bool tripped_for(const std::string& why) const {
    return !trips.empty() && trips.back().find(why) != std::string::npos;
  }
};

TEST_F(HeartbeatLineTest, BeatsAtItsRateFromBeforeTheFirstCurrent) {
  clock->sleep_for(1s);
  EXPECT_TRUE(line.edges.empty()) << "nothing is energized";
  interlock->set_currents(kOne);
  EXPECT_FALSE(amplifier.stepped_while_off);
  for (int i = 0; i < 200; ++i) {
    clock->sleep_for(10ms);
    ASSERT_EQ(amplifier.flows(), 1) << i;
  }
  EXPECT_NEAR(static_cast<double>(line.edges.size()), 2.05 * 50, 2);
  EXPECT_TRUE(trips.empty());
}

TEST_F(HeartbeatLineTest, AZeroThatPassesDoesNotSwitchTheRelayAndALongOneDoes) {
  clock->sleep_for(10s);
  interlock->set_currents(kZero);
  clock->sleep_for(1s);
  EXPECT_TRUE(line.edges.empty()) << "a zero needs no relay";
  interlock->set_currents(kOne);
  interlock->set_currents(kZero);
  clock->sleep_for(1s);
  EXPECT_TRUE(line.on());
  interlock->set_currents(kOne);
  clock->sleep_for(1s);
  interlock->set_currents(kZero);
  clock->sleep_for(2300ms);
  EXPECT_FALSE(line.on());
  interlock->set_currents(kOne);
  clock->sleep_for(20ms);
  EXPECT_EQ(amplifier.flows(), 1);
  EXPECT_FALSE(amplifier.stepped_while_off);
  EXPECT_TRUE(trips.empty());
}

// Opening supplies takes seconds, which are no rest of the line's.
TEST_F(HeartbeatLineTest, BeatsOnThoughNothingWasEnergizedForLongBefore) {
  interlock->make_safe();  // wakes the watch
  interlock->enable();
  clock->sleep_for(10s);
  for (int i = 0; i < 3; ++i) {
    interlock->make_safe();
    interlock->enable();
    interlock->set_currents(kOne);
    clock->sleep_for(300ms);
    ASSERT_EQ(amplifier.flows(), 1) << i;
    interlock->make_safe();
    interlock->enable();
    clock->sleep_for(3s);
  }
  EXPECT_TRUE(trips.empty()) << trips.back();
}

TEST_F(HeartbeatLineTest, StopsWhenALoopIsStuck) {
  Interlock::Heartbeat loop(*interlock, "servo");
  interlock->set_currents(kOne);
  const Time began = clock->now();
  for (int i = 0; i < 100; ++i) {
    loop.beat();
    clock->sleep_for(10ms);
  }
  ASSERT_EQ(amplifier.flows(), 1);
  amplifier.deaf = true;  // no zero of the interlock's gets through
  const auto off = off_after();
  ASSERT_TRUE(off) << to_seconds(clock->now() - began);
  EXPECT_LT(*off, 250 + 20 + 70 + 20);
  EXPECT_TRUE(tripped_for("servo has not moved"));
  EXPECT_EQ(amplifier.set, kOne) << "the amplifier still holds it";
}

TEST_F(HeartbeatLineTest, StopsWhenAConditionFails) {
  bool held = true;
  interlock->require("the pedal is released", [&] { return held; });
  interlock->set_currents(kOne);
  clock->sleep_for(500ms);
  held = false;
  amplifier.deaf = true;
  const auto off = off_after();
  ASSERT_TRUE(off);
  EXPECT_LE(*off, 20 + 70 + 2);
  EXPECT_TRUE(tripped_for("the pedal is released"));
}

TEST_F(HeartbeatLineTest, AnEmergencyStopStopsItWhateverTheAmplifierDoes) {
  interlock->set_currents(kOne);
  clock->sleep_for(200ms);
  amplifier.deaf = true;
  EXPECT_THROW(interlock->make_safe(), DeviceError);
  const auto off = off_after();
  ASSERT_TRUE(off);
  EXPECT_LE(*off, 70 + 2);
}

// The goal of the whole: off within 100 ms of a supply's own cable, at whatever moment, with a
// relay that takes 15 ms to open.
TEST_F(HeartbeatLineTest, TheNextEdgeDoesNotComeWhenTheAmplifiersLinkHangsUp) {
  for (int trial = 0; trial < 20; ++trial) {
    amplifier.links = {};
    amplifier.deaf = false;
    interlock->enable();
    interlock->set_currents(kOne);
    clock->sleep_for(200ms + trial * 1700us);
    const std::size_t edges = line.edges.size();
    amplifier.links.hung_up = "channel 2, serial:/dev/ttyUSB1";
    amplifier.deaf = true;
    const auto off = off_after();
    ASSERT_TRUE(off);
    EXPECT_LE(*off, 70 + 15) << trial;
    EXPECT_EQ(line.edges.size(), edges);
    EXPECT_TRUE(tripped_for("channel 2, serial:/dev/ttyUSB1 has hung up")) << trips.back();
    amplifier.deaf = false;
    interlock->make_safe();
  }
}

// A network cable that is out hangs nothing up: the supply falls silent.
TEST_F(HeartbeatLineTest, AnAnswerThatIsOwedForTooLongWithholdsTheEdges) {
  interlock->set_currents(kOne);
  clock->sleep_for(200ms);
  amplifier.links.owed = 140ms;
  clock->sleep_for(300ms);
  EXPECT_TRUE(trips.empty()) << "a slow answer";
  amplifier.links.owed = 151ms;
  amplifier.deaf = true;
  const auto off = off_after();
  ASSERT_TRUE(off);
  EXPECT_LE(*off, 20 + 70 + 2);
  EXPECT_TRUE(tripped_for("has owed an answer for 151 ms"));
}

// The relay opens while the program is held up: what is held must not come back with the next edge.
TEST_F(HeartbeatLineTest, DoesNotSwitchOnAgainAfterAPauseOfTheWholeProgram) {
  interlock->set_currents(kOne);
  clock->sleep_for(200ms);
  line.hangs = 150ms;  // one report that takes so long
  clock->sleep_for(30ms);
  line.hangs = {};
  clock->sleep_for(1s);
  EXPECT_EQ(amplifier.flows(), 0);
  EXPECT_EQ(amplifier.set, kZero);
  EXPECT_TRUE(tripped_for("heartbeat line")) << (trips.empty() ? "no trip" : trips.back());
  EXPECT_TRUE(broken) << "a run that only waits would go on";
  EXPECT_THROW(interlock->set_currents(kOne), DeviceError);
  interlock->enable();
  interlock->set_currents(kOne);
  clock->sleep_for(20ms);
  EXPECT_EQ(amplifier.flows(), 1);
}

TEST_F(HeartbeatLineTest, ALineThatIsGoneIsATrip) {
  interlock->set_currents(kOne);
  clock->sleep_for(200ms);
  line.broken = true;
  clock->sleep_for(200ms);
  EXPECT_EQ(amplifier.set, kZero);
  EXPECT_TRUE(tripped_for("unplugged"));
}

TEST_F(HeartbeatLineTest, ALineThatIsGoneFromTheBeginningLetsNoCurrentFlow) {
  line.broken = true;
  EXPECT_THROW(interlock->set_currents(kOne), DeviceError);
  EXPECT_EQ(amplifier.set, kZero);
}

TEST_F(HeartbeatLineTest, RestsTwoSecondsAfterTheLastCurrentAndNoLonger) {
  for (int trial = 0; trial < 5; ++trial) {
    interlock->set_currents(kOne);
    clock->sleep_for(1s + trial * 3ms);
    interlock->set_currents(kZero);
    clock->sleep_for(1940ms);
    const std::size_t edges = line.edges.size();
    clock->sleep_for(61ms);
    EXPECT_LE(line.edges.size(), edges + 3);
    const std::size_t last = line.edges.size();
    clock->sleep_for(500ms);
    EXPECT_EQ(line.edges.size(), last) << trial;
  }
}

TEST_F(HeartbeatLineTest, ALinkThatHangsUpAtZeroIsNoTripThoughTheLineBeats) {
  interlock->set_currents(kOne);
  clock->sleep_for(200ms);
  interlock->set_currents(kZero);
  amplifier.links.hung_up = "channel 2";
  clock->sleep_for(1s);
  EXPECT_TRUE(trips.empty()) << trips.back();
}

TEST_F(HeartbeatLineTest, AStopPutsTheAmplifierToZeroThoughTheLineIsGoneAndSaysSo) {
  interlock->set_currents(kOne);
  clock->sleep_for(5ms);
  line.broken = true;
  EXPECT_THROW(interlock->make_safe(), DeviceError);
  EXPECT_EQ(amplifier.set, kZero);
  EXPECT_FALSE(interlock->energized());
}

TEST(HeartbeatSettings, AreRefusedWhereTheOneShotIsTooShortForTheRate) {
  EXPECT_NO_THROW(HeartbeatSettings{}.check());
  EXPECT_THROW((HeartbeatSettings{50, 0.045, 0.05}.check()), std::invalid_argument);
  EXPECT_THROW((HeartbeatSettings{5, 0.5, 0.05}.check()), std::invalid_argument);
  EXPECT_THROW((HeartbeatSettings{200, 0.1, 0.05}.check()), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
