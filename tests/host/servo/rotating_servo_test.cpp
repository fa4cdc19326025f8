// Servo loop that turns the field, on the simulated rig with its USB: it swims, and whatever
// happens ends at zero.
// SPDX-License-Identifier: Apache-2.0
#include "host/servo/servo.h"
#include "tests/host/rig/fake_rig.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace vitreo {
namespace VITREO_TEST_FILE {

constexpr double kAtRest = 2e-4;  // V: half a count of the converter

RigDescription swimming_rig() {
  RigDescription description = whole_rig();
  description.table["model"] = ConfigValue{ConfigTable{{"robot", {"helix_2mm"}}}};
  return description;
}

ServoSettings swimming() {
  ServoSettings settings;
  settings.law = ControlLaw::rotating;
  settings.feedback = Feedback::pose_sensor;
  settings.field = 2e-3;
  return settings;
}

double output_of(TestBench& bench) {
  double most = 0;
  for (const double volts : bench.rig->laboratory()->coil_outputs().outputs())
    most = std::max(most, std::abs(volts));
  return most;
}

bool recorded(const TestBench& bench, const std::string& kind) {
  return std::any_of(bench.recorder->events().begin(), bench.recorder->events().end(),
                     [&](const auto& event) { return event.kind == kind; });
}

TEST(RotatingServo, SwimsToAPlaceAndHoldsItThere) {
  TestBench bench(1, {}, swimming_rig());
  const auto servo = bench.held(5, swimming());
  servo->follow(control::Trajectory::line({0, 0, 0}, {1.5e-3, 0.5e-3, 0}, {0.5e-3, 0.5e-3}));
  bench.clock->sleep_for(from_seconds(8));
  const Eigen::Vector3d truth = bench.rig->laboratory()->truth(bench.clock->now())->position;
  EXPECT_LT((truth - Eigen::Vector3d(1.5e-3, 0.5e-3, 0)).norm(), 60e-6);
  ASSERT_TRUE(servo->rotation());
  // Eleven reports of a millisecond for each set-point, and never more than six turns' worth.
  EXPECT_NEAR(servo->rotation()->set_points, 90, 5);
  EXPECT_LT(servo->rotation()->limit, 15.5);
  EXPECT_GT(std::abs(servo->rotation()->rotation.frequency), 0.3);  // against its weight
}

TEST(RotatingServo, TurnsTheFieldBetweenTheFramesAsItIsTold) {
  TestBench bench(1, {}, swimming_rig());
  const auto servo = bench.held(1, swimming());
  servo->spin(Eigen::Vector3d::UnitX(), 5);
  bench.clock->sleep_for(from_seconds(1.5));
  // Turns of the true field in two seconds, counted by its angle every 5 ms.
  double angle = 0, before = 0, least = 1, most = 0;
  for (int k = 0; k < 400; ++k) {
    bench.clock->sleep_for(from_seconds(5e-3));
    const auto truth = bench.rig->laboratory()->truth(bench.clock->now());
    const Eigen::Vector3d b = bench.rig->laboratory()->field(truth->position, bench.clock->now());
    const double now = std::atan2(b.z(), b.y());
    if (k > 0) angle += std::remainder(now - before, 2 * M_PI);
    before = now;
    least = std::min(least, b.norm());
    most = std::max(most, b.norm());
  }
  EXPECT_NEAR(angle / (2 * M_PI), 10, 0.2);
  EXPECT_NEAR(least, 2e-3, 0.4e-3);  // coils that are a few percent off the model's
  EXPECT_NEAR(most, 2e-3, 0.4e-3);
}

TEST(RotatingServo, ClosingItLeavesTheOutputsAtZero) {
  TestBench bench(1, {}, swimming_rig());
  const auto servo = bench.held(2, swimming());
  servo->spin(Eigen::Vector3d::UnitX(), 10);
  bench.clock->sleep_for(from_seconds(0.5));
  EXPECT_GT(output_of(bench), 0.05);
  servo->close();
  EXPECT_LT(output_of(bench), kAtRest);
  bench.clock->sleep_for(from_seconds(0.5));
  EXPECT_LT(output_of(bench), kAtRest) << "the rotor sends no more";
}

TEST(RotatingServo, ARobotThatIsGoneIsLostAndTheCoilsGoToZeroUntilAGoalIsGiven) {
  TestBench bench(1, {}, swimming_rig());
  const auto servo = bench.held(2, swimming());
  bench.roles().sample->remove_robot();
  bench.clock->sleep_for(from_seconds(2.5));
  EXPECT_EQ(servo->status().state, ServoState::lost);
  EXPECT_LT(output_of(bench), kAtRest);
  bench.roles().sample->insert_robot({0, 0, 0});
  bench.clock->sleep_for(from_seconds(0.5));
  EXPECT_TRUE(servo->status().position) << "it is seen";
  EXPECT_LT(output_of(bench), kAtRest);
  servo->hold({0, 0, 0});
  bench.clock->sleep_for(from_seconds(1));
  EXPECT_GT(output_of(bench), 0.05);
}

// The loop's own set-points come from another task: what that is refused ends the loop.
TEST(RotatingServo, ATripEndsTheLoopWithTheCoilsAtZero) {
  TestBench bench(1, {}, swimming_rig());
  const auto servo = bench.held(2, swimming());
  bench.roles().coils->trip("a test");
  bench.clock->sleep_for(from_seconds(0.5));
  EXPECT_EQ(servo->status().state, ServoState::failed);
  EXPECT_NE(servo->status().failure.find("a test"), std::string::npos) << servo->status().failure;
  EXPECT_LT(output_of(bench), kAtRest);
}

// The rotor goes on by itself, and must not keep the coils alive for a loop that sees nothing.
TEST(RotatingServo, WithoutReadingsTheDeadManOpensThoughTheRotorBeats) {
  TestBench bench(1, {}, swimming_rig());
  const auto servo = bench.held(2, swimming());
  bench.rig->laboratory()->faults().looks["pose_sensor"].silent = true;
  bench.clock->sleep_for(from_seconds(0.6));
  EXPECT_NE(bench.roles().coils->tripped().find("servo"), std::string::npos)
      << bench.roles().coils->tripped();
  EXPECT_LT(output_of(bench), kAtRest);
}

TEST(RotatingServo, RefusesWhatItIsNotFor) {
  TestBench bench(1, {}, swimming_rig());
  const auto servo = bench.held(1, swimming());
  EXPECT_THROW(servo->turn(control::DirectionPath::hold({0, 0, 1})), std::invalid_argument);
  servo->close();
  ServoSettings pulling = swimming();
  pulling.law = ControlLaw::pd;
  const auto other = bench.held(1, pulling);
  EXPECT_THROW(other->spin({1, 0, 0}, 1), std::invalid_argument);
  EXPECT_FALSE(other->rotation());
}

TEST(RotatingServo, AStepOutIsAnEventAndAnAlarm) {
  TestBench bench(1, {}, swimming_rig());
  ServoSettings settings = swimming();
  settings.field = 1e-3;
  settings.rotating.frequency = 15;
  const auto servo = bench.held(3, settings);
  const double believed = servo->rotation()->believed_step_out;
  servo->spin(Eigen::Vector3d::UnitX(), 0.5 * believed);
  bench.clock->sleep_for(from_seconds(1.8));
  EXPECT_FALSE(recorded(bench, "step-out"));
  servo->spin(Eigen::Vector3d::UnitX(), 1.3 * believed);
  bench.clock->sleep_for(from_seconds(1));
  EXPECT_TRUE(recorded(bench, "step-out"));
  EXPECT_LT(servo->rotation()->limit, believed);
  bench.clock->sleep_for(from_seconds(1.5));
  EXPECT_TRUE(recorded(bench, "in step"));
}

/// m, of the true robot's surface from the retina, the least over `span` (s).
double least_clearance(TestBench& bench, double span) {
  RobotClearance truly(bench.roles().model, {Eigen::Vector3d::UnitX(), 0, false, false});
  double least = 1;
  for (double time = 0; time < span; time += 0.05) {
    bench.clock->sleep_for(from_seconds(0.05));
    const auto truth = bench.rig->laboratory()->truth(bench.clock->now());
    truly.expect_axis(truth->axis, 0);
    least = std::min(least, truly.at(truth->position)->retina.distance);
  }
  return least;
}

// Down on the retina by hand, then along it while gravity pulls: the margin slows the first, and
// turns the axis up in the second.
TEST(RotatingServo, ASpinTowardsTheRetinaEndsAtTheMargin) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    TestBench bench(seed, {}, swimming_rig());
    const auto servo = bench.held(3, swimming());
    const double margin = servo->margin();
    servo->spin(-Eigen::Vector3d::UnitZ(), 8);
    const double down = least_clearance(bench, 10);
    // The true robot may be a little larger than the one whose bound is kept.
    EXPECT_GT(down, 0.5 * margin) << seed;
    EXPECT_LT(down, 4 * margin) << seed << ": it went there";
    EXPECT_TRUE(recorded(bench, "degraded")) << seed << ": the margin changes the command";
    servo->spin(Eigen::Vector3d::UnitX(), 2);
    EXPECT_GT(least_clearance(bench, 8), 0.75 * margin) << seed;
  }
}

// The robot's axis as a part of the reference, in the loop with the pose sensor.
TEST(ServoAttitude, TurnsTheRobotsAxisWhereItIsTold) {
  TestBench bench;
  ServoSettings settings = swimming();
  settings.law = ControlLaw::estimator;
  settings.field = 12e-3;
  const auto servo = bench.held(3, settings);
  const Eigen::Vector3d wanted = Eigen::Vector3d(0.6, 0.4, 0.69).normalized();
  servo->turn(control::DirectionPath::through({servo->direction(), wanted}, 0.5));
  EXPECT_FALSE(servo->status().turned);
  bench.clock->sleep_for(from_seconds(9));
  EXPECT_TRUE(servo->status().turned);
  const auto truth = bench.rig->laboratory()->truth(bench.clock->now());
  EXPECT_GT(std::abs(truth->axis.dot(wanted)), std::cos(1.0 * M_PI / 180));
  ASSERT_TRUE(servo->status().axis);
  EXPECT_GT(servo->status().axis->dot(wanted), std::cos(5 * M_PI / 180));
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
