// Clearance by what a loop believes, the margin of paths, the watch of walls, and the loop at the
// margin: no command crosses it.
// SPDX-License-Identifier: Apache-2.0
#include "host/servo/robot_clearance.h"

#include "host/servo/servo.h"
#include "host/servo/wall_watch.h"
#include "tests/control/surface_samples.h"
#include "tests/host/rig/fake_rig.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>
#include <string>

namespace vitreo {
namespace VITREO_TEST_FILE {

RigDescription rig_with_margin(double margin) {
  RigDescription description = whole_rig();
  description.table["keep_out"] = ConfigValue{ConfigTable{{"margin", {margin}}}};
  return description;
}

ServoSettings by_pose(ControlLaw law = ControlLaw::estimator) {
  ServoSettings settings;
  settings.law = law;
  settings.feedback = Feedback::pose_sensor;
  return settings;
}

std::string refusal(const std::function<void()>& call) {
  try {
    call();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

/// m, of the true surface.
double true_clearance(TestBench& bench) {
  const auto truth = bench.rig->laboratory()->truth(bench.clock->now());
  const control::Robot& robot = bench.roles().model.robot;
  return samples::least_distance({}, samples::spheroid(robot.semi_axis, robot.semi_radius),
                                 truth->position, truth->axis)
      .nearest();
}

control::WallClearance wall_at(double distance) { return {distance, {0, 0, 1}, 0.1e-3}; }

// What the interlock judges a push by: the wall's clearance with the place that it is of.
TEST(RobotClearance, OfTwoPlacesEachWallHasTheNearerAndItsPlace) {
  const Eigen::Vector3d high(0, 0, 8e-3), low(1e-3, 0, -3e-3);
  const PlacedClearance seen = placed_at(high, {wall_at(12e-3), wall_at(1e-3)});
  const PlacedClearance believed = placed_at(low, {wall_at(0.8e-3), wall_at(11e-3)});
  for (const PlacedClearance& both : {nearer_of(seen, believed), nearer_of(believed, seen)}) {
    EXPECT_EQ(both.walls.retina.distance, 0.8e-3);
    EXPECT_EQ(both.walls.lens.distance, 1e-3);
    EXPECT_EQ(both.near_retina, low);
    EXPECT_EQ(both.near_lens, high);
    EXPECT_EQ(both.nearest_place(), low);
  }
}

// A measurement's doubt by attitude stays while the robot lies as it does: no filter averages it.
TEST(RobotClearance, ADoubtByAttitudeIsInTheBoundOfEveryPlaceFromThenOn) {
  TestBench bench;
  RobotClearance surface(bench.roles().model, by_pose().clearance_belief());
  const Eigen::Vector3d place(0, 0, -3e-3);
  const double before = surface.at(place)->retina.uncertainty;
  constexpr double kSigma = 0.4e-3;  // m, along z
  surface.doubt_by_attitude(Eigen::Vector3d(0, 0, kSigma * kSigma).asDiagonal());
  const double after = surface.at(place)->retina.uncertainty;
  EXPECT_GT(after, 2.5 * kSigma);
  EXPECT_LT(after, before + 2.6 * kSigma);
}

TEST(RobotClearance, ATargetInsideOfTheRetinaOrTheMarginIsRefusedWithTheClearanceInMillimeters) {
  TestBench bench;
  const auto servo = bench.held(1, by_pose());
  const std::string inside = refusal([&] { servo->hold({0, 0, -4.9e-3}); });
  EXPECT_NE(inside.find("0.40 mm inside the retina"), std::string::npos) << inside;
  EXPECT_NE(inside.find("0.20 mm must be left (keep_out.margin)"), std::string::npos) << inside;
  const std::string near = refusal([&] { servo->hold({0, 0, -4.4e-3}); });
  EXPECT_NE(near.find("0.10 mm from the retina"), std::string::npos) << near;
  EXPECT_NE(refusal([&] { servo->hold({0, 0, 10e-3}); }).find("lens"), std::string::npos);
  EXPECT_EQ(servo->status().target, Eigen::Vector3d(0, 0, 0)) << "the old place is held";
  EXPECT_EQ(refusal([&] {
              servo->hold({0, 0, -4.1e-3});
            }),
            "")
      << "0.15 mm of doubt: the eye's place";
}

TEST(RobotClearance, AnUprightRobotNeedsMoreRoomThanOneThatLies) {
  TestBench bench;
  ServoSettings settings = by_pose();
  settings.axis = {0, 0, 1};
  const auto servo = bench.held(1, settings);
  EXPECT_NE(refusal([&] {
              servo->hold({0, 0, -4.2e-3});
            }).find("inside the retina"),
            std::string::npos);
  EXPECT_EQ(refusal([&] { servo->hold({0, 0, -3.6e-3}); }), "");
}

TEST(RobotClearance, APathThatCrossesTheMarginIsRefusedBeforeItStarts) {
  TestBench bench;
  const auto servo = bench.held(1, by_pose());
  const auto dipping =
      control::Trajectory::waypoints({{0, 0, 0}, {0, 0, -4.45e-3}, {1e-3, 0, 0}}, {1e-3, 2e-3});
  EXPECT_NE(refusal([&] { servo->follow(dipping); }).find("retina"), std::string::npos);
  EXPECT_EQ(servo->status().state, ServoState::holding);
}

TEST(RobotClearance, WhatLiesOnTheRetinaMayBeLiftedButNotLowered) {
  const TestBench bench;
  const RobotClearance surface(bench.rig->rig().model, by_pose().clearance_belief());
  const Eigen::Vector3d lying(0, 0, -4.5e-3);
  EXPECT_NO_THROW(surface.check(control::Trajectory::line(lying, {0, 0, 0}, {})));
  EXPECT_THROW(surface.check(control::Trajectory::waypoints({lying, {0, 0, -4.7e-3}, {0, 0, 0}},
                                                            {1e-3, 2e-3})),
               std::invalid_argument);
  EXPECT_THROW(surface.check(control::Trajectory::hold_at(lying)), std::invalid_argument);
}

TEST(RobotClearance, ThroughAnEyeItIsLessCertainAndLeastSoWhereTheEyeIsNotKnown) {
  TestBench known;
  RigDescription doubted = whole_rig();
  doubted.table["keep_out"] = ConfigValue{ConfigTable{{"eye", {std::string("table_5_1")}}}};
  TestBench unknown(1, {}, doubted);
  ServoSettings settings;
  settings.feedback = Feedback::one_camera;
  const Eigen::Vector3d place(0, 0, -3e-3);
  const auto uncertainty = [&](TestBench& bench, const ServoSettings& with) {
    return RobotClearance(bench.roles().model, with.clearance_belief())
        .at(place)
        ->retina.uncertainty;
  };
  const double by_truth = uncertainty(known, by_pose());
  const double by_image = uncertainty(known, settings);
  const double by_unknown_eye = uncertainty(unknown, settings);
  settings.view.image_scale = 1.01;
  const double calibrated = uncertainty(unknown, settings);
  EXPECT_NEAR(by_truth, 0.14e-3, 0.02e-3) << "50 um of the eye's place, and the axis";
  EXPECT_GT(by_image, 0.6e-3) << "1.5 % of size is 0.3 mm of depth";
  EXPECT_GT(by_unknown_eye, 1.5 * by_image);
  EXPECT_LT(calibrated, 0.5 * by_unknown_eye) << "on the retina, where it counts";
}

// Whatever way the robot is found, its retina may stand elsewhere; a look at the robot that lies on
// it says where it is seen.
TEST(RobotClearance, OfABenchSetUpByHandHasTheRetinasDepthUntilTheRobotWasSeenOnIt) {
  RigModel known = TestBench().roles().model;
  RigModel by_hand = known;
  by_hand.uncertainty.bench = {};
  const Eigen::Vector3d place(0, 0, -3e-3);
  const auto uncertainty = [&](const RigModel& model, const ServoSettings& with) {
    return RobotClearance(model, with.clearance_belief()).at(place)->retina.uncertainty;
  };
  EXPECT_GT(uncertainty(by_hand, by_pose()), 2.5 * 0.3e-3);
  ServoSettings settings;
  settings.feedback = Feedback::one_camera;
  const double before = uncertainty(by_hand, settings);
  EXPECT_GT(before, std::hypot(uncertainty(known, settings), 2.5 * 0.3e-3));
  settings.view.image_scale = 1.01;
  EXPECT_LT(uncertainty(by_hand, settings), 0.4 * before);
}

// The picture of such a bench is a millimeter aside, by which the retina leans otherwise than it is
// seen: at the place of the look that is put right, and nowhere else.
TEST(RobotClearance, ALookAsideOfTheMiddleTellsLessOfTheOtherSide) {
  RigModel by_hand = TestBench().roles().model;
  by_hand.uncertainty.bench = {};
  ServoSettings settings;
  settings.feedback = Feedback::one_camera;
  settings.view.image_scale = 1.01;
  const auto uncertainty = [&](double looked_at, double place) {
    settings.view.looked_at = {looked_at, 0, 0.5e-3};
    return RobotClearance(by_hand, settings.clearance_belief())
        .at({place, 0, -3e-3})
        ->retina.uncertainty;
  };
  EXPECT_EQ(uncertainty(-1.2e-3, -1.5e-3), uncertainty(0, -1.5e-3));
  const double same = uncertainty(0, 0.8e-3), other = uncertainty(-1.2e-3, 0.8e-3);
  // 0.8 mm aside (one sigma) times 2 mm over a radius of 11.5 mm, at 99 %.
  EXPECT_GT(other, same + 0.05e-3);
  EXPECT_NEAR(other * other - same * same,
              std::pow(2.576 * 0.8e-3 / 11.5e-3, 2) * (std::pow(2e-3, 2) - std::pow(0.8e-3, 2)),
              0.35 * std::pow(2.576 * 0.8e-3 * 2e-3 / 11.5e-3, 2));
}

// The way out is in the refusal, where a look would be one.
TEST(RobotClearance, WhatIsRefusedOfABenchSetUpByHandSaysThatALookWouldHelp) {
  RigModel by_hand = TestBench().roles().model;
  by_hand.uncertainty.bench = {};
  ServoSettings settings;
  settings.feedback = Feedback::one_camera;
  const auto said = [](const RigModel& model, const ServoSettings& with) {
    return refusal([&] {
      RobotClearance(model, with.clearance_belief())
          .check(control::Trajectory::hold_at({0, 0, -4.4e-3}));
    });
  };
  const std::string advice = "a look at the robot that lies on the retina";
  EXPECT_NE(said(by_hand, settings).find(advice), std::string::npos) << said(by_hand, settings);
  EXPECT_EQ(said(by_hand, by_pose()).find(advice), std::string::npos) << "no camera looks";
  RigModel known = by_hand;
  known.uncertainty.bench = BenchUncertainty::none();
  EXPECT_EQ(said(known, settings).find(advice), std::string::npos);
  settings.view.image_scale = 1.01;
  EXPECT_EQ(said(by_hand, settings).find(advice), std::string::npos) << "it was looked at";
}

TEST(RobotClearance, TheMarginOfTheRigFileIsReadWithItsBounds) {
  EXPECT_EQ(TestBench(1, {}, rig_with_margin(0.35e-3)).roles().model.keep_out.margin, 0.35e-3);
  EXPECT_THROW(TestBench(1, {}, rig_with_margin(-1e-4)), ConfigError);
  EXPECT_THROW(TestBench(1, {}, rig_with_margin(5e-3)), ConfigError) << "a slip of a unit";
}

// Nothing that a call would take: the trim presses the robot down with 0.4 mm/s.
TEST(RobotClearance, WhateverPressesItEveryLawKeepsTheMargin) {
  for (const ControlLaw law : {ControlLaw::estimator, ControlLaw::pd}) {
    TestBench bench(3, {}, rig_with_margin(0.3e-3));
    const auto servo = bench.held(2, by_pose(law));
    servo->hold({0, 0, -3.5e-3});
    bench.clock->sleep_for(from_seconds(8));
    servo->set_trim(servo->force_for({0, 0, -0.4e-3}));
    servo->release();
    double least = 1;
    for (int k = 0; k < 200; ++k) {
      bench.clock->sleep_for(from_seconds(0.05));
      least = std::min(least, true_clearance(bench));
    }
    EXPECT_GT(least, 0.25e-3) << to_string(law);
    // The margin is of the bound: 0.15 mm nearer, as the eye's place is not known.
    EXPECT_LT(least, 0.55e-3) << "it was pressed to the margin; " << to_string(law);
    EXPECT_TRUE(servo->status().kept_out) << to_string(law);
    EXPECT_TRUE(servo->quality().kept_out) << to_string(law);
    EXPECT_FALSE(servo->quality().good()) << to_string(law);
  }
}

TEST(RobotClearance, OnlyWhoSaysSoLaysItOnTheRetinaAndTheRecordHasIt) {
  TestBench bench(3);
  const auto servo = bench.held(2, by_pose());
  servo->hold({0, 0, -3.5e-3});
  bench.clock->sleep_for(from_seconds(8));
  servo->set_trim(servo->force_for({0, 0, -0.6e-3}));
  servo->release(false, true);
  bench.clock->sleep_for(from_seconds(6));
  EXPECT_LT(true_clearance(bench), 5e-6);
  ASSERT_TRUE(servo->status().clearance);
  EXPECT_LT(servo->status().clearance->nearest().bound(), 0.02e-3);
  servo->set_trim({0, 0, 0});
  servo->hold({0, 0, 0});
  bench.clock->sleep_for(from_seconds(12));
  EXPECT_GT(true_clearance(bench), 3e-3) << "and it is lifted again";
  int events = 0;
  for (const Event& event : bench.recorder->events())
    if (event.kind == "keep-out margin") ++events;
  EXPECT_EQ(events, 2) << "off and on";
}

TEST(RobotClearance, TheRecordHasAStreamOfIt) {
  TestBench bench(2);
  const auto servo = bench.held(3, by_pose());
  for (const Stream& stream : bench.recorder->streams()) {
    if (stream.info.name != "clearance") continue;
    ASSERT_GT(stream.times.size(), 30U);
    const std::size_t row = stream.times.size() - 1;
    EXPECT_NEAR(stream.at(row, 0), stream.at(row, 1) - stream.at(row, 2), 1e-12) << "the bound";
    EXPECT_NEAR(stream.at(row, 1), 4.5e-3, 0.1e-3);
    EXPECT_EQ(stream.at(row, 6), 0.2e-3);
    return;
  }
  FAIL() << "no stream clearance";
}

class WallWatchTest : public ::testing::Test {
 protected:
  WallSight sight(double time, double height, double target) {
    const Eigen::Vector3d at(0, 0, -5e-3 + height);
    control::UncertainPose pose;
    pose.position = at;
    pose.axis_sigma = 0;
    return {time, control::clearance({}, {}, pose), at, {0, 0, -5e-3 + target}, false};
  }
  WallWatch watch{0.2e-3};
};

TEST_F(WallWatchTest, BrieflyInsideTheMarginIsNoAlarmAndLongerIs) {
  EXPECT_FALSE(watch.see(sight(0, 0.8e-3, 0.8e-3)).inside);
  EXPECT_FALSE(watch.see(sight(0.1, 0.6e-3, 0.8e-3)).inside);
  EXPECT_FALSE(watch.see(sight(0.4, 0.6e-3, 0.8e-3)).inside);
  EXPECT_TRUE(watch.see(sight(0.7, 0.6e-3, 0.8e-3)).inside);
  EXPECT_TRUE(watch.see(sight(0.8, 0.68e-3, 0.8e-3)).inside) << "not yet out of it";
  EXPECT_FALSE(watch.see(sight(0.9, 0.71e-3, 0.8e-3)).inside);
}

// The review's session: 0.65 mm on the page, the target 0.5 mm deeper, and nothing moved for 25 s.
TEST_F(WallWatchTest, ARobotThatIsToldDownAndDoesNotComeIsPressed) {
  bool pressed = false;
  double when = 0;
  for (int k = 0; k < 45 && !pressed; ++k) {
    when = k / 15.0;
    pressed = watch.see(sight(when, 1.15e-3 + (k % 2) * 5e-6, 0.65e-3)).pressed;
  }
  EXPECT_TRUE(pressed);
  EXPECT_NEAR(when, WallWatch::kLong, 0.2);
}

TEST_F(WallWatchTest, OneThatMovesOrIsThereOrIsFarFromEveryWallIsNot) {
  for (int k = 0; k < 60; ++k) {
    const double time = k / 15.0;
    EXPECT_FALSE(watch.see(sight(time, 1.4e-3 - k * 5e-6, 0.9e-3)).pressed) << "75 um/s";
  }
  watch.forget();
  for (int k = 0; k < 60; ++k)
    EXPECT_FALSE(watch.see(sight(k / 15.0, 1.0e-3, 0.9e-3)).pressed)
        << "a standing error of 0.1 mm";
  watch.forget();
  for (int k = 0; k < 60; ++k)
    EXPECT_FALSE(watch.see(sight(k / 15.0, 4e-3, 3e-3)).pressed) << "in the middle of the eye";
}

// A loop that lifts a robot off a wall does so in a second or two.
TEST_F(WallWatchTest, ARobotThatHasTouchedAWallForFiveSecondsLies) {
  const double touching = 0.5e-3;  // m: its center, lying
  const auto lies = [&](double from, double to) {
    bool lying = false;
    for (double time = from; time < to; time += 1 / 15.0)
      lying = lying || watch.see(sight(time, touching, 2e-3)).lying;
    return lying;
  };
  const double distance = sight(0, touching, 2e-3).clearance.nearest().distance;
  ASSERT_LT(std::abs(distance), WallWatch::kTouches);
  EXPECT_FALSE(lies(0, 4.9));
  EXPECT_FALSE(watch.see(sight(4.95, touching + 30e-6, 2e-3)).lying) << "it came off";
  EXPECT_FALSE(lies(5, 9.8));
  EXPECT_TRUE(lies(9.8, 10.2));
  watch.forget();
  EXPECT_FALSE(watch.see(sight(10.3, touching, 2e-3)).lying) << "a new goal";
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
