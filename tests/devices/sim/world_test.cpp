// The plant: fall, drift and contact against physics.
// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/world.h"

#include <Eigen/LU>
#include <gtest/gtest.h>

namespace vitreo::sim {
namespace VITREO_TEST_FILE {

constexpr Time kMs = std::chrono::milliseconds(1);
const Eigen::Vector3d kNone = Eigen::Vector3d::Zero();

WorldSettings quiet() {
  WorldSettings settings;
  settings.coils.noise = 0;
  settings.placement_scatter = 0;
  return settings;
}

TEST(World, ARobotWithoutAFieldSinksAtItsStokesVelocity) {
  WorldSettings settings = quiet();
  settings.wall_drag = false;
  World world(settings, 1);
  world.insert_robot(Time(0), kNone);
  const double start = world.robot(100 * kMs)->position.z(),
               end = world.robot(600 * kMs)->position.z();
  // 1565 um/s is what the facts compute for this robot in 500 cSt oil; 2 % for the rounding of its
  // tabulated numbers
  EXPECT_NEAR((start - end) / 0.5, 1565e-6, 0.02 * 1565e-6);
}

TEST(World, ARobotComesToRestOnTheRetinaAndStaysThere) {
  World world(quiet(), 1);
  world.insert_robot(Time(0), {2e-3, 0, 0});
  const Eigen::Vector3d after = world.robot(20000 * kMs)->position,
                        later = world.robot(20400 * kMs)->position;
  EXPECT_LT((later - after).norm(), 0.5e-3);  // it may creep down the slope
  const Eigen::Vector3d center(0, 0, -5e-3 + 11.5e-3);
  const double distance = (later - center).norm();
  EXPECT_LT(distance, 11.5e-3 - 0.45e-3);  // inside by at least about its smaller radius
  EXPECT_GT(distance, 11.5e-3 - 1.05e-3);  // and touching
}

TEST(World, ACommandActsAfterTheDelayAndRisesWithTheBandwidth) {
  World world(quiet(), 1);
  control::Currents one = control::Currents::Ones(8);
  world.set_coil_commands(10 * kMs, one);
  EXPECT_EQ(world.currents(60 * kMs)[0], 0) << "50 ms of delay";
  const double tau = 1 / (2 * M_PI * 15);
  EXPECT_NEAR(world.currents(80 * kMs)[0], 1 - std::exp(-0.020 / tau), 0.02)
      << "20 ms later; a step of 1 ms is 0.09 tau";
  EXPECT_NEAR(world.currents(400 * kMs)[0], 1, 1e-9);
}

TEST(World, TheAxisFollowsTheField) {
  WorldSettings settings = quiet();
  World world(settings, 1);
  world.insert_robot(Time(0), kNone);
  const control::FieldMatrix matrix = settings.field.matrix(kNone);
  const Eigen::Vector3d wanted(0, 10e-3, 0);
  const Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, 8> b = matrix.topRows<3>();
  world.set_coil_commands(Time(0), b.transpose() * (b * b.transpose()).inverse() * wanted);
  // from just across, where it balances: ln(1e4) times 24 ms (torque over drag at 10 mT), and the
  // coils before that
  EXPECT_LT(std::abs(world.robot(100 * kMs)->axis.y()), 0.1);
  EXPECT_GT(std::abs(world.robot(450 * kMs)->axis.y()), 0.99);
}

TEST(World, TheSameSeedGivesTheSameMotionToTheBit) {
  WorldSettings settings;
  const auto run = [&](std::uint64_t seed) {
    World world(settings, seed);
    world.insert_robot(Time(0), kNone);
    world.set_coil_commands(Time(0), control::Currents::Constant(8, 1.5));
    return world.robot(900 * kMs)->position;
  };
  EXPECT_EQ(run(3), run(3));
  EXPECT_NE(run(3), run(4));
}

TEST(World, AskingOftenOrRarelyMakesNoDifference) {
  World often(WorldSettings{}, 5), rarely(WorldSettings{}, 5);
  often.insert_robot(Time(0), kNone);
  rarely.insert_robot(Time(0), kNone);
  for (int i = 1; i < 700; ++i) often.robot(i * kMs);
  EXPECT_EQ(often.robot(700 * kMs)->position, rarely.robot(700 * kMs)->position);
}

TEST(World, ThePastCanBeAskedForHalfASecond) {
  World world(quiet(), 1);
  world.insert_robot(Time(0), kNone);
  const Eigen::Vector3d then = world.robot(800 * kMs)->position;
  world.robot(1200 * kMs);
  EXPECT_EQ(world.robot(800 * kMs)->position, then);
  EXPECT_THROW(world.robot(100 * kMs), std::out_of_range);
}

TEST(World, AnAbsentRobotIsNowhere) {
  World world(quiet(), 1);
  EXPECT_EQ(world.robot(5 * kMs), nullptr);
  world.insert_robot(10 * kMs, kNone);
  EXPECT_NE(world.robot(20 * kMs), nullptr);
  world.remove_robot(30 * kMs);
  EXPECT_EQ(world.robot(40 * kMs), nullptr);
}

TEST(World, ImpossibleParametersAreNamed) {
  WorldSettings settings;
  settings.coils.bandwidth = 0;
  try {
    World world(settings, 1);
    FAIL() << "a bandwidth of zero was taken";
  } catch (const std::invalid_argument& error) {
    EXPECT_NE(std::string(error.what()).find("coil_bandwidth"), std::string::npos);
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::sim
