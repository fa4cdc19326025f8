// Watch of the lamp: a light that is held does not go on where the lamp is gone, its heartbeat line
// has stopped, or is watched no more.
// SPDX-License-Identifier: Apache-2.0
#include "host/safety/watched_lamp.h"

#include "devices/sim/one_shot.h"
#include "devices/time/error.h"

#include <gtest/gtest.h>

#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

/// A lamp with a one-shot and a relay on its own line.
class WiredLamp final : public Lamp {
 public:
  explicit WiredLamp(Clock& clock) : line_{*this, clock}, clock_(clock) {}
  std::string identity() const override { return "wired"; }
  void set_level(double level) override {
    if (!(level >= 0 && level <= 1)) throw std::invalid_argument("level");
    answer();
    if (!line_.relay.on(clock_.now())) lit_while_off = true;
    level_ = level;
  }
  double level() const override { return level_; }
  LinkState link_state() const override { return {gone && tells ? "the lamp" : "", Time::zero()}; }
  void ask() override {
    ++asked;
    answer();
  }
  void make_safe() override {
    ++darkened;
    answer();
    level_ = 0;
    line_.set(false);
  }
  EnableLine* enable_line() override { return &line_; }
  /// With the relay in its supply.
  double shines() { return line_.relay.on(clock_.now()) ? level_ : 0; }
  bool relay_is_closed() { return line_.relay.on(clock_.now()); }

  bool gone = false, line_broken = false;
  bool tells = false;  // its link shows that it is gone
  Time takes{};        // of each exchange
  bool lit_while_off = false;
  int asked = 0, darkened = 0;

 private:
  struct Line final : EnableLine {
    Line(WiredLamp& its, Clock& time) : lamp(its), clock(time) {}
    std::string identity() const override { return "line"; }
    void set(bool asserted) override {
      if (lamp.line_broken || lamp.gone) throw DeviceError(DeviceErrorKind::lost, "lamp", "line");
      level = asserted;
      relay.input(asserted, clock.now());
    }
    bool high() const override { return level; }
    void make_safe() override { set(false); }
    WiredLamp& lamp;
    Clock& clock;
    bool level = false;
    sim::OneShot relay{70ms};
  };
  void answer() {
    if (takes > Time::zero()) clock_.sleep_for(takes);
    if (gone) throw DeviceError(DeviceErrorKind::lost, "lamp", "unplugged");
  }
  Line line_;
  Clock& clock_;
  double level_ = 0;
};

struct WatchedLampTest : testing::Test {
  std::unique_ptr<Clock> clock = virtual_clock();
  WiredLamp wired{*clock};
  std::vector<std::string> failures;
  std::unique_ptr<WatchedLamp> lamp = std::make_unique<WatchedLamp>(
      wired, *clock, [this](const std::string& why) { failures.push_back(why); });

  /// ms until a failure is told; nothing within a second.
  std::optional<double> told_after() {
    const Time began = clock->now();
    while (clock->now() - began < 1s) {
      if (!failures.empty()) return to_seconds(clock->now() - began) * 1e3;
      clock->sleep_for(1ms);
    }
    return std::nullopt;
  }
};

TEST_F(WatchedLampTest, IsAskedWhileItBurnsAndNotInTheDark) {
  clock->sleep_for(1s);
  EXPECT_EQ(wired.asked, 0);
  lamp->set_level(0.5);
  clock->sleep_for(2s);
  EXPECT_NEAR(wired.asked, 10, 3) << "5 to 10 Hz";
  lamp->set_level(0);
  const int asked = wired.asked;
  clock->sleep_for(1s);
  EXPECT_EQ(wired.asked, asked);
  EXPECT_TRUE(failures.empty());
}

TEST_F(WatchedLampTest, ThatIsGoneIsToldOnceWithin250MsAndDarkenedWhenItIsBack) {
  lamp->set_level(0.5);
  clock->sleep_for(333ms);
  wired.gone = true;
  const auto told = told_after();
  ASSERT_TRUE(told);
  EXPECT_LT(*told, 250);
  EXPECT_NE(failures[0].find("does not answer while it burns"), std::string::npos) << failures[0];
  EXPECT_NE(failures[0].find("does not take the zero"), std::string::npos) << failures[0];
  clock->sleep_for(1s);
  EXPECT_EQ(wired.level(), 0.5) << "it may still shine";
  wired.gone = false;
  clock->sleep_for(100ms);
  EXPECT_EQ(wired.level(), 0);
  EXPECT_EQ(failures.size(), 1U);
}

TEST_F(WatchedLampTest, WhoseLinkHangsUpIsToldAtOnceAndWithoutAQuestion) {
  wired.tells = true;
  lamp->set_level(0.5);
  clock->sleep_for(333ms);
  const int asked = wired.asked;
  wired.gone = true;
  const auto told = told_after();
  ASSERT_TRUE(told);
  EXPECT_LE(*told, 6);
  EXPECT_EQ(wired.asked, asked);
  EXPECT_NE(failures[0].find("has hung up"), std::string::npos) << failures[0];
  clock->sleep_for(1s);
  EXPECT_EQ(failures.size(), 1U);
  wired.gone = false;
  clock->sleep_for(100ms);
  EXPECT_EQ(wired.level(), 0);
}

TEST_F(WatchedLampTest, CanBeLitAgainAfterAFault) {
  lamp->set_level(0.5);
  wired.gone = true;
  ASSERT_TRUE(told_after());
  wired.gone = false;
  clock->sleep_for(100ms);
  lamp->set_level(0.3);
  clock->sleep_for(1s);
  EXPECT_EQ(wired.level(), 0.3);
}

TEST_F(WatchedLampTest, ALevelThatIsNoneLeavesItDark) {
  EXPECT_THROW(lamp->set_level(2), std::invalid_argument);
  clock->sleep_for(1s);
  EXPECT_EQ(wired.asked, 0);
}

TEST_F(WatchedLampTest, DarkenedWhileALevelIsOnItsWayStaysDark) {
  wired.takes = 100ms;
  const auto other = clock->spawn("other", [this] {
    clock->sleep_for(50ms);
    lamp->make_safe();
  });
  EXPECT_THROW(lamp->set_level(0.5), DeviceError);
  clock->sleep_for(1s);
  EXPECT_EQ(wired.level(), 0);
}

struct BeatingLampTest : WatchedLampTest {
  BeatingLampTest() { lamp->beat({}); }
};

TEST_F(BeatingLampTest, ShinesBehindAClosedRelayOnly) {
  clock->sleep_for(1s);
  EXPECT_FALSE(wired.relay_is_closed());
  lamp->set_level(0.5);
  EXPECT_FALSE(wired.lit_while_off);
  for (int i = 0; i < 200; ++i) {
    clock->sleep_for(10ms);
    ASSERT_EQ(wired.shines(), 0.5) << i;
  }
  EXPECT_TRUE(failures.empty());
}

TEST_F(BeatingLampTest, BlinksWithoutTheRelayAndRestsInALongDark) {
  for (int i = 0; i < 10; ++i) {
    lamp->set_level(0.5);
    clock->sleep_for(200ms);
    lamp->set_level(0);
    EXPECT_TRUE(wired.relay_is_closed()) << i;
    clock->sleep_for(200ms);
    EXPECT_TRUE(wired.relay_is_closed()) << i;
  }
  clock->sleep_for(2200ms);
  EXPECT_FALSE(wired.relay_is_closed());
  lamp->set_level(0.5);
  EXPECT_EQ(wired.shines(), 0.5);
  EXPECT_FALSE(wired.lit_while_off);
  EXPECT_TRUE(failures.empty());
}

TEST_F(BeatingLampTest, ALineThatIsGoneDarkensIt) {
  lamp->set_level(0.5);
  clock->sleep_for(333ms);
  wired.line_broken = true;
  const auto told = told_after();
  ASSERT_TRUE(told);
  EXPECT_LT(*told, 50);
  EXPECT_NE(failures[0].find("heartbeat line has stopped"), std::string::npos) << failures[0];
  clock->sleep_for(100ms);
  EXPECT_EQ(wired.shines(), 0);
}

// Its question hangs: nothing watches the light any more.
TEST_F(BeatingLampTest, AWatchThatIsStuckLetsTheRelayOpen) {
  lamp->set_level(0.5);
  clock->sleep_for(333ms);
  wired.takes = 5s;
  clock->sleep_for(1s);
  EXPECT_EQ(wired.shines(), 0);
  clock->sleep_for(10s);  // the question, then the zero
  ASSERT_EQ(failures.size(), 1U);
  EXPECT_NE(failures[0].find("the watch of the lamp is stuck"), std::string::npos) << failures[0];
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
