// Servo loop on the simulated rig: control, loss and recovery of the robot, safe release.
// SPDX-License-Identifier: Apache-2.0
#include "host/servo/servo.h"

#include "host/session/error_statistics.h"
#include "tests/host/rig/fake_rig.h"

#include <gtest/gtest.h>

#include <cmath>

namespace vitreo {
namespace VITREO_TEST_FILE {

double largest(const std::vector<double>& currents) {
  double most = 0;
  for (const double current : currents) most = std::max(most, std::abs(current));
  return most;
}

double largest_output(OpenRig& rig) {
  double most = 0;
  for (const double volts : rig.laboratory()->coil_outputs().outputs())
    most = std::max(most, std::abs(volts));
  return most;
}

// An output at rest may differ from zero by half a count of its converter.
constexpr double kZeroVolts = 2e-4;

TEST(Servo, ItHoldsTheRobotThroughTheEye) {
  TestBench bench(1, {}, rig_of_known_size());
  const auto servo = bench.held(6);
  const ServoStatus status = servo->status();
  EXPECT_EQ(status.state, ServoState::holding);
  ASSERT_TRUE(status.position);
  const Eigen::Vector3d truth = bench.rig->laboratory()->truth(bench.clock->now())->position;
  // untrimmed, with a field model that is 3 % off: the PD's standing error; the weight alone would
  // sink it by 9 mm
  EXPECT_LT(truth.norm(), 0.5e-3);
  EXPECT_LT((*status.position - truth).norm(), 0.15e-3)
      << "the localization in the middle of the image";
}

TEST(Servo, ItFollowsAPathAndHoldsItsEnd) {
  TestBench bench;
  const auto servo = bench.held(3);
  servo->follow(control::Trajectory::line({0, 0, 0}, {1e-3, 0, 1e-3}, {1e-3, 0.1}));
  EXPECT_EQ(servo->status().progress, 0);
  bench.clock->sleep_for(from_seconds(0.8));
  EXPECT_EQ(servo->status().state, ServoState::following);
  EXPECT_NEAR(servo->status().progress, 0.5, 0.2);
  bench.clock->sleep_for(from_seconds(3));
  EXPECT_EQ(servo->status().state, ServoState::holding);
  EXPECT_LT((*servo->status().position - Eigen::Vector3d(1e-3, 0, 1e-3)).norm(), 0.5e-3);
}

TEST(Servo, TrimmingTakesTheStandingErrorAway) {
  TestBench bench;
  const auto servo = bench.held(6);
  EXPECT_THROW(servo->mean_correction(20), std::logic_error) << "it has not held for that long";
  const double before = servo->status().position->norm();
  servo->set_trim(servo->trim() + servo->mean_correction(2));
  bench.clock->sleep_for(from_seconds(4));
  EXPECT_LT(servo->status().position->norm(), 0.4 * before);
}

double rms_error(const TestBench& bench, double from, double to) {
  return error_statistics(*bench.recorder, "truth", "", "servo", "target_", from_seconds(from),
                          from_seconds(to))
      .rms;
}

ServoSettings with(ControlLaw law, Feedback feedback) {
  ServoSettings settings;
  settings.law = law;
  settings.feedback = feedback;
  return settings;
}

TEST(Servo, TheEstimatorHoldsTheUntrimmedRobotWhereThePdDoesNot) {
  TestBench bench(3);
  const auto servo = bench.held(8, with(ControlLaw::estimator, Feedback::pose_sensor));
  EXPECT_LT(rms_error(bench, 4, 9), 10e-6);
  EXPECT_GT(servo->status().disturbance->norm(), 20e-6) << "m/s: what the model lacks is known";
}

TEST(Servo, WithTwoCamerasTheDepthIsKnownBetterThanWithOne) {
  const auto depth_error = [](Feedback feedback) {
    TestBench bench(2, {}, rig_of_known_size());
    const auto servo = bench.held(5, with(ControlLaw::estimator, feedback));
    return error_statistics(*bench.recorder, "servo", "", "truth", "", from_seconds(3),
                            from_seconds(6))
        .depth_rms;
  };
  EXPECT_LT(depth_error(Feedback::two_cameras), 8e-6);
  EXPECT_GT(depth_error(Feedback::one_camera), 10e-6);
}

TEST(Servo, AnAxisThatIsNotQuiteTheCommandedOneIsNotTakenForADepth) {
  // The third machine's coils pitch the true field by 2.8 degrees. Size, pixels and tilts as
  // believed: each makes a depth of its own. Of plates, as the robot is, and of an ellipsoid
  // that is drawn and believed.
  const auto depth_error = [](const std::string& drawn_as, double sigma) {
    RigDescription rig = whole_rig();
    rig.table["truth"] = ConfigValue{ConfigTable{{"machine", {"coils"}}, {"drawn_as", {drawn_as}}}};
    if (drawn_as == "ellipsoid")
      rig.table["model"] = ConfigValue{ConfigTable{{"shape", {drawn_as}}}};
    TestBench bench(3, {}, rig);
    ServoSettings settings = with(ControlLaw::estimator, Feedback::one_camera);
    settings.axis_sigma = sigma;
    settings.field_max = settings.field;  // more of it would turn the robot less
    const auto servo = bench.held(1, settings);
    servo->hold({2e-3, 0, 1e-3});
    bench.clock->sleep_for(from_seconds(5));
    return error_statistics(*bench.recorder, "servo", "", "truth", "", from_seconds(5),
                            from_seconds(7))
        .depth_rms;
  };
  for (const char* drawn_as : {"plates", "ellipsoid"}) {
    const double taken = depth_error(drawn_as, 0), estimated = depth_error(drawn_as, 0.07);
    EXPECT_GT(taken, 25e-6) << drawn_as;
    // Of plates 55 of 95 um: their drawn rim is 0.15 px inside of the body's, which without a look
    // on the retina is half a percent of scale (docs/figures.md). An ellipsoid has no such error.
    const double part = drawn_as == std::string("plates") ? 0.65 : 0.5;
    EXPECT_LT(estimated, part * taken) << drawn_as;
  }
}

TEST(Servo, AnOffsetMovesTheHeldPlaceAndOneThatIsNoBiasIsRefused) {
  TestBench bench(2);
  const auto servo = bench.held(6, with(ControlLaw::estimator, Feedback::one_camera));
  const double before = bench.rig->laboratory()->truth(bench.clock->now())->position.z();
  servo->set_offset({0, 0, 60e-6});
  bench.clock->sleep_for(from_seconds(6));
  EXPECT_NEAR(bench.rig->laboratory()->truth(bench.clock->now())->position.z(), before - 60e-6,
              20e-6);
  EXPECT_THROW(servo->set_offset({0, 0, 4e-3}), std::invalid_argument);
  EXPECT_THROW(servo->set_offset({NAN, 0, 0}), std::invalid_argument);
  EXPECT_EQ(servo->offset().z(), 60e-6);
}

// As `hold` does it before its measurement; the plant watch had taken the leap for exchanged leads,
// and the filter for a current.
TEST(Servo, AnOffsetIsNoMotionOfTheRobot) {
  // A pose sensor's readings are not corrected, and its filter must not be either.
  for (const ServoSettings& settings : {with(ControlLaw::estimator, Feedback::one_camera),
                                        with(ControlLaw::pd, Feedback::one_camera),
                                        with(ControlLaw::estimator, Feedback::pose_sensor)}) {
    TestBench bench(2);
    const auto servo = bench.held(6, settings);
    const std::optional<Eigen::Vector3d> before = servo->status().disturbance;
    servo->set_offset({86e-6, 0, -201e-6});
    for (int i = 0; i < 40; ++i) {
      bench.clock->sleep_for(from_seconds(0.1));
      const ServoStatus now = servo->status();
      ASSERT_EQ(now.state, ServoState::holding) << now.failure;
      if (!before) continue;
      EXPECT_LT((*now.disturbance - *before).norm(), 100e-6) << "m/s, after " << i;
    }
  }
}

// A correction may come at any moment of the loop's turn: while a frame is waited for, while it is
// looked at, or while its currents are on their way. A place by the view of before, judged as if it
// were of the view of now, was a motion of 0.6 mm/s (`hold --seed 2`: exchanged leads).
TEST(Servo, AnOffsetIsNoMotionAtAnyMomentOfTheTurn) {
  TestBench bench(2);
  const auto servo = bench.held(6, with(ControlLaw::estimator, Feedback::one_camera));
  const double period = 1.0 / 15;
  for (int k = 0; k < 12; ++k) {
    const double held = std::ceil(to_seconds(bench.clock->now()) / period) * period;
    bench.clock->sleep_until(from_seconds(held + k * period / 12));
    servo->set_offset(k % 2 == 0 ? Eigen::Vector3d(80e-6, 0, -340e-6) : Eigen::Vector3d(0, 0, 0));
    for (int i = 0; i < 30; ++i) {
      bench.clock->sleep_for(from_seconds(0.1));
      const ServoStatus now = servo->status();
      ASSERT_EQ(now.state, ServoState::holding) << now.failure << ", " << k << " twelfths";
    }
  }
}

// A robot is put elsewhere: until the filter takes it, the old place is as likely as the new one.
TEST(Servo, APlaceThatIsPassedOverShowsNoMoreRoomThanTheFilterKnows) {
  TestBench bench(2);
  const auto servo = bench.held(6, with(ControlLaw::estimator, Feedback::pose_sensor));
  servo->follow(control::Trajectory::line({0, 0, 0}, {0, 0, -1.5e-3}, {1e-3, 0.1}));
  bench.clock->sleep_for(from_seconds(6));
  const double before = servo->status().clearance->nearest().bound();
  ASSERT_LT(before, 3e-3);
  const Eigen::Vector3d high(0, 0, 4e-3);
  bench.roles().sample->insert_robot(high);
  int leapt = 0, taken = 0;
  for (int i = 0; i < 60 && taken == 0; ++i) {
    bench.clock->sleep_for(from_seconds(0.02));
    const ServoStatus now = servo->status();
    if (!now.position || now.position->z() < 2e-3) continue;
    if (now.clearance->nearest().bound() > before + 2e-3)
      ++taken;
    else
      ++leapt;
  }
  EXPECT_GE(leapt, 3) << "shown near the wall while only the reading had leapt";
  EXPECT_EQ(taken, 1) << "and free once the filter has taken it";
}

TEST(Servo, APlainViewFromAboveNeedsASecondCamera) {
  RigDescription plain = whole_rig();
  plain.table["top_camera"] = ConfigValue{ConfigTable{{"view", {"plain"}}}};
  TestBench bench(1, {}, plain);
  EXPECT_THROW(Servo(*bench.clock, bench.roles(), *bench.recorder, bench.eyes(), {}),
               std::invalid_argument);
}

TEST(Servo, WithoutFeedbackAReleasedRobotHasConstantCurrents) {
  TestBench bench;
  const auto servo = bench.held(2, with(ControlLaw::pd, Feedback::none));
  servo->release();
  bench.clock->sleep_for(from_seconds(0.3));
  const std::vector<double> before = bench.roles().coils->currents();
  bench.clock->sleep_for(from_seconds(1));
  EXPECT_EQ(bench.roles().coils->currents(), before);
  EXPECT_EQ(servo->status().state, ServoState::released);
  EXPECT_TRUE(servo->status().position) << "it is still watched";
}

TEST(Servo, ADeadCoilStaysWithoutCurrentAndTheRobotIsHeldByTheOthers) {
  TestBench bench(3);
  ServoSettings settings = with(ControlLaw::estimator, Feedback::pose_sensor);
  settings.dead_coils = {4};
  const auto servo = bench.held(6, settings);
  EXPECT_EQ(bench.roles().coils->currents()[3], 0);
  EXPECT_LT(rms_error(bench, 4, 7), 10e-6);
  EXPECT_GT(servo->status().headroom, 0.3);
  settings.dead_coils = {9};
  servo->close();
  EXPECT_THROW(Servo(*bench.clock, bench.roles(), *bench.recorder, bench.eyes(), settings),
               std::invalid_argument);
}

TEST(Servo, APlaceOutOfReachIsRefusedAndTheOldOneHeld) {
  TestBench bench;
  const auto servo = bench.held(1);
  EXPECT_THROW(servo->hold({0.1, 0, 0}), std::invalid_argument);
  EXPECT_THROW(servo->hold({0, 0, 11e-3}), std::invalid_argument) << "behind the lens";
  EXPECT_THROW(servo->follow(control::Trajectory::line({0, 0, 0}, {0, 0, -9e-3}, {})),
               std::invalid_argument);
  EXPECT_EQ(servo->status().state, ServoState::holding);
  EXPECT_EQ(servo->status().target, Eigen::Vector3d(0, 0, 0));
}

TEST(Servo, APlaceThatTheTopCameraCannotSeeIsRefusedToALoopThatSteersByIt) {
  const Eigen::Vector3d aside(8.5e-3, 0,
                              2e-3);  // in the vitreous, beyond the image's edge
  TestBench bench;
  const auto servo = bench.held(1);
  try {
    servo->hold(aside);
    FAIL() << "it was let";
  } catch (const std::invalid_argument& error) {
    EXPECT_NE(
        std::string(error.what()).find("(8.50, 0.00, 2.00) mm is out of the top camera's sight"),
        std::string::npos)
        << error.what();
  }
  EXPECT_EQ(servo->status().target, Eigen::Vector3d(0, 0, 0));
  TestBench other;
  const auto without = other.held(1, with(ControlLaw::estimator, Feedback::pose_sensor));
  EXPECT_NO_THROW(without->hold(aside)) << "the pose sensor needs no camera";
}

TEST(Servo, AFeedbackIsRefusedWithoutWhatItNeeds) {
  RigDescription poor = whole_rig();
  poor.table.erase("pose_sensor");
  poor.table.erase("side_camera");
  TestBench bench(1, {}, poor);
  const auto opening = [&](Feedback feedback) {
    try {
      Servo servo(*bench.clock, bench.roles(), *bench.recorder, bench.eyes(),
                  with(ControlLaw::pd, feedback));
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string("opened");
  };
  EXPECT_NE(opening(Feedback::pose_sensor).find("pose_sensor, which only a simulated rig"),
            std::string::npos);
  EXPECT_NE(opening(Feedback::two_cameras).find("side_camera"), std::string::npos);
  EXPECT_EQ(opening(Feedback::one_camera), "opened");
  EXPECT_THROW(feedback_named("both"), std::invalid_argument);
}

Stream recorded(const TestBench& bench, const std::string& name) {
  return *bench.recorder->stream(name);
}

TEST(LoopAndTruth, ShiftingTheReportedTruthLeavesEveryCurrentAsItWas) {
  TestBench honest(7), shifted(7, {{0.5e-3, 0, 0}, {0, 0, 0}});
  const auto first = honest.held(2), second = shifted.held(2);
  EXPECT_EQ(recorded(honest, "currents").values, recorded(shifted, "currents").values);
  const Stream truth = recorded(honest, "truth"), other = recorded(shifted, "truth");
  ASSERT_EQ(truth.times.size(), other.times.size());
  ASSERT_GT(truth.times.size(), 20U);
  EXPECT_NEAR(other.at(20, 0) - truth.at(20, 0), 0.5e-3, 1e-12);
}

TEST(LoopAndTruth, ShiftingTheDrawnRobotChangesTheCurrents) {
  TestBench honest(7), shifted(7, {{0, 0, 0}, {0.5e-3, 0, 0}});
  const auto first = honest.held(2), second = shifted.held(2);
  const Stream currents = recorded(honest, "currents"), other = recorded(shifted, "currents");
  ASSERT_EQ(currents.times, other.times);
  double difference = 0;
  for (std::size_t i = 0; i < currents.values.size(); ++i)
    difference = std::max(difference, std::abs(currents.values[i] - other.values[i]));
  EXPECT_GT(difference, 0.05) << "A";
}

TEST(LoopAndTruth, OnlyTheLoopThatAsksForThePoseSensorSeesTheTruthAndTheRecordSaysSo) {
  const ServoSettings asking = with(ControlLaw::pd, Feedback::pose_sensor);
  TestBench honest(7), shifted(7, {{0.5e-3, 0, 0}, {0, 0, 0}});
  const auto first = honest.held(2, asking), second = shifted.held(2, asking);
  EXPECT_NE(recorded(honest, "currents").values, recorded(shifted, "currents").values);
  EXPECT_NE(recorded(honest, "servo").info.source.find("simulator's truth"), std::string::npos);
  std::string said;
  for (const Event& event : honest.recorder->events())
    if (event.kind == "feedback") said += event.text;
  EXPECT_NE(said.find("pose_sensor"), std::string::npos) << said;
}

TEST(LoopAndTruth, EveryFeedbackThatLooksIsBlindToTheReportedTruth) {
  for (const Feedback feedback : {Feedback::none, Feedback::two_cameras}) {
    TestBench honest(7), shifted(7, {{0.5e-3, 0, 0}, {0, 0, 0}});
    const auto first = honest.held(1, with(ControlLaw::estimator, feedback)),
               second = shifted.held(1, with(ControlLaw::estimator, feedback));
    EXPECT_EQ(recorded(honest, "currents").values, recorded(shifted, "currents").values)
        << to_string(feedback);
  }
}

TEST(Determinism, TheSameSeedGivesTheSameBytes) {
  const auto bytes = [](std::uint64_t seed) {
    TestBench bench(seed);
    const auto servo = bench.held(1.5);
    return canonical_export(*bench.recorder);
  };
  const std::string first = bytes(11);
  EXPECT_GT(first.size(), 1000U);
  EXPECT_EQ(first, bytes(11));
  EXPECT_NE(first, bytes(12));
}

TEST(Servo, ClosingItLeavesTheOutputsAtZero) {
  TestBench bench;
  auto servo = bench.held(1);
  EXPECT_GT(largest_output(*bench.rig), 0.1);
  servo->close();
  EXPECT_LT(largest_output(*bench.rig), kZeroVolts);
  EXPECT_EQ(servo->status().state, ServoState::closed);
  servo->close();  // once more does nothing
}

TEST(Servo, AfterOneIsClosedAnotherCanBeOpened) {
  TestBench bench;
  bench.held(1)->close();
  const auto servo = bench.held(2);
  EXPECT_EQ(servo->status().state, ServoState::holding);
}

TEST(Servo, ARobotThatIsGoneIsLostAndTheCoilsGoToZero) {
  TestBench bench;
  const auto servo = bench.held(1);
  bench.roles().sample->remove_robot();
  bench.clock->sleep_for(from_seconds(2.5));
  EXPECT_EQ(servo->status().state, ServoState::lost);
  EXPECT_LT(largest_output(*bench.rig), kZeroVolts);
  // found again it is not driven until it has a new target
  bench.roles().sample->insert_robot({0, 0, 0});
  bench.clock->sleep_for(from_seconds(0.5));
  EXPECT_TRUE(servo->status().position) << "it is seen";
  EXPECT_LT(largest_output(*bench.rig), kZeroVolts);
  servo->hold({0, 0, 0});
  bench.clock->sleep_for(from_seconds(0.5));
  EXPECT_GT(largest_output(*bench.rig), 0.1);
}

TEST(Servo, BeforeTheRobotIsInItOnlyKeepsTheField) {
  TestBench bench;
  Servo servo(*bench.clock, bench.roles(), *bench.recorder, bench.eyes(), {});
  bench.clock->sleep_for(from_seconds(0.5));
  EXPECT_EQ(servo.status().state, ServoState::searching);
  EXPECT_FALSE(servo.status().position);
}

TEST(Servo, ATripOfTheInterlockEndsTheLoopWithTheCoilsAtZero) {
  TestBench bench;
  const auto servo = bench.held(1);
  bench.roles().coils->make_safe();
  bench.clock->sleep_for(from_seconds(0.5));
  EXPECT_EQ(servo->status().state, ServoState::failed);
  EXPECT_NE(servo->status().failure.find("interlock"), std::string::npos)
      << servo->status().failure;
  EXPECT_LT(largest(bench.roles().coils->currents()), 1e-9);
}

TEST(Servo, ImpossibleSettingsAreNamed) {
  ServoSettings settings;
  settings.field = 1;
  EXPECT_THROW(settings.check(), std::invalid_argument);
  settings = {};
  settings.axis = {1, 1, 0};
  EXPECT_THROW(settings.check(), std::invalid_argument);
  settings = {};
  settings.axis_sigma = -0.1;
  EXPECT_THROW(settings.check(), std::invalid_argument);
}

TEST(SideCamera, ItSeesWhereTheRobotIs) {
  TestBench bench;
  const auto servo = bench.held(4);
  const ErrorStatistics error = error_statistics(*bench.recorder, "side_camera", "", "truth", "",
                                                 from_seconds(2), from_seconds(3.5));
  EXPECT_GT(error.count, 10U);
  EXPECT_LT(error.rms, 30e-6) << "1.5 of its pixels; y is not seen and not compared";
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
