// Behavior common to all stages: the check before a motion, and moving and waiting in one.
// SPDX-License-Identifier: Apache-2.0
#include "devices/roles/rotation_stage.h"
#include "devices/roles/stage.h"
#include "devices/time/error.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <limits>
#include <numbers>
#include <stdexcept>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Position = std::vector<double>;

const std::vector<StageAxis> kAxes{{"x", -1e-3, 1e-3, 5e-3, 1e-3, 1e-6},
                                   {"z", 0, 2e-3, 2e-3, 1e-3, 1e-6}};

void expect_refusal(const std::function<void()>& work, const std::string& naming) {
  try {
    work();
    ADD_FAILURE() << "no error that names " << naming;
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.kind, DeviceErrorKind::out_of_range);
    EXPECT_EQ(error.device, "focus");
    EXPECT_NE(std::string(error.what()).find(naming), std::string::npos) << error.what();
  }
}

void check(const Position& target, double speed) {
  check_motion(kAxes, target, speed, "focus", "m");
}

TEST(CheckMotion, LetsATargetOnTheEdgeOfTheTravelThroughAtFullSpeed) {
  EXPECT_NO_THROW(check({-1e-3, 2e-3}, 2e-3));
  EXPECT_NO_THROW(check({0, 0}, 1e-9));
}

TEST(CheckMotion, RefusesATargetOutsideTheTravelAndNamesTheAxis) {
  expect_refusal([] { check({1.0001e-3, 0}, 1e-3); }, "axis x");
  expect_refusal([] { check({0, -1e-9}, 1e-3); }, "axis z");
}

TEST(CheckMotion, RefusesASpeedThatOneAxisCannotKeep) {
  expect_refusal([] { check({0, 0}, 2.1e-3); }, "axis z");
}

TEST(CheckMotion, ThrowsForWhatIsNoTarget) {
  const double nan = std::numeric_limits<double>::quiet_NaN(),
               infinity = std::numeric_limits<double>::infinity();
  for (const Position& bad :
       {Position{}, Position{0}, Position{0, 0, 0}, Position{0, nan}, Position{infinity, 0}})
    EXPECT_THROW(check(bad, 1e-3), std::invalid_argument);
  for (const double bad : {0., -1e-3, nan, infinity})
    EXPECT_THROW(check({0, 0}, bad), std::invalid_argument);
}

TEST(CheckMotion, LetsAnAxisThatTurnsWithoutEndTurn) {
  const double infinity = std::numeric_limits<double>::infinity();
  const std::vector<StageAxis> turntable{{"theta", -infinity, infinity, 1, 0.5, 1e-4}};
  const Position far{100 * std::numbers::pi};
  EXPECT_NO_THROW(check_motion(turntable, far, 1, "turntable", "rad"));
}

/// Takes a second for each motion.
struct SlowStage final : Stage {
  explicit SlowStage(Clock& its_clock) : clock(its_clock) {}
  const StageInfo& info() const override { return its_info; }
  Position position() override { return at; }
  void start(std::span<const double> target, double) override {
    at.assign(target.begin(), target.end());
    goes_on = true;
  }
  bool moving() override { return goes_on; }
  void wait(Time timeout) override {
    clock.sleep_for(std::min<Time>(timeout, 1s));
    if (timeout < 1s) throw DeviceError(DeviceErrorKind::timeout, "slow", "not there in time");
    goes_on = false;
  }
  void home(Time) override {}
  void stop() override {
    goes_on = false;
    ++stops;
    if (broken) throw DeviceError(DeviceErrorKind::lost, "slow", "gone");
  }
  void make_safe() override { stop(); }

  Clock& clock;
  StageInfo its_info{{"slow stage", "", ""}, kAxes};
  Position at{0, 0};
  bool goes_on = false, broken = false;
  int stops = 0;
};

TEST(MoveTo, WaitsUntilTheStageIsThere) {
  const auto clock = virtual_clock();
  SlowStage stage(*clock);
  move_to(stage, Position{1e-3, 1e-3}, 1e-3, 2s, *clock);
  EXPECT_EQ(clock->now(), 1s);
  EXPECT_EQ(stage.stops, 0);
}

TEST(MoveTo, StopsAStageThatIsNotThereInTimeAndReportsTheFirstError) {
  const auto clock = virtual_clock();
  SlowStage stage(*clock);
  stage.broken = true;
  try {
    move_to(stage, Position{1e-3, 1e-3}, 1e-3, 500ms, *clock);
    ADD_FAILURE() << "no error";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.kind, DeviceErrorKind::timeout);
  }
  EXPECT_EQ(stage.stops, 1);
}

TEST(MoveTo, StopsTheStageWhenItsTaskIsStopped) {
  const auto clock = virtual_clock();
  SlowStage stage(*clock);
  const auto task = clock->spawn("mover", [&] {
    move_to(stage, Position{1e-3, 1e-3}, 1e-3, 2s, *clock);
  });
  clock->sleep_for(300ms);
  EXPECT_TRUE(stage.goes_on);
  task->request_stop();
  task->join();
  EXPECT_FALSE(stage.goes_on);
  EXPECT_EQ(stage.stops, 1);
}

TEST(Identity, LeavesOutWhatTheInstrumentDoesNotTell) {
  EXPECT_EQ(to_string(Identity{"Sutter MP-285", "", "4.31"}), "Sutter MP-285, firmware 4.31");
  EXPECT_EQ(to_string(Identity{"Zaber X-RSW60A", "12345", "7.14"}),
            "Zaber X-RSW60A, serial 12345, firmware 7.14");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
