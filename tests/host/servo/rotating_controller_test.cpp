// Rotating controller on the simulator's own plant, without devices: path, step-out, recovery, and
// two robots under one field.
// SPDX-License-Identifier: Apache-2.0
#include "host/servo/rotating_controller.h"

#include "tests/bench/machines/swim_bench.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numbers>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using machines::centimeter;
using machines::helix_model;
using machines::path_error;
using machines::SwimBench;
using std::chrono::milliseconds;

TEST(RotatingController, SwimsACentimeterWithinFiftyMicrometersOnSampledMachines) {
  EXPECT_GT(centimeter().length(), 10e-3);
  for (unsigned seed = 1; seed <= 6; ++seed) {
    int told = 0;
    EXPECT_LT(path_error(seed, nullptr, &told), 50e-6) << seed;
    EXPECT_EQ(told, 0) << seed;  // no step-out, none told
  }
}

TEST(RotatingController, HoldsAHelixAgainstItsWeight) {
  SwimBench bench(3, {}, 2e-3);
  bench.go(8);
  double worst = 0;
  bench.go(10, [&](double, const sim::BodyState& robot) {
    worst = std::max(worst, (robot.position - Eigen::Vector3d(-4e-3, 0, 0)).norm());
  });
  EXPECT_LT(worst, 30e-6);
  EXPECT_TRUE(bench.found.empty());
}

/// From half the true step-out to a fifth above it: the time until it is told.
TEST(RotatingController, TellsAStepOutWithinASecondAndGoesOnBelowIt) {
  const double field = 1e-3;
  for (unsigned seed = 1; seed <= 10; ++seed) {
    RotatingSettings law;
    law.frequency = 30;
    SwimBench bench(seed, law, field, helix_model(), {-4e-3, 0, 0}, milliseconds(4));
    bench.go(2);
    const double step_out = bench.true_step_out(field);
    bench.controller().spin(Eigen::Vector3d::UnitX(), 0.5 * step_out);
    bench.go(1.5);
    ASSERT_TRUE(bench.found.empty()) << seed;
    const double begin = bench.now();
    bench.controller().spin(Eigen::Vector3d::UnitX(), 1.2 * step_out);
    bench.go(2.5);
    ASSERT_FALSE(bench.found.empty()) << seed;
    EXPECT_LT(bench.found.front() - begin, 1) << seed;
    // The field at the robot differs from the commanded by some percent.
    EXPECT_NEAR(bench.controller().state().response.step_out / step_out, 1, 0.15) << seed;
    EXPECT_FALSE(bench.recovered.empty()) << seed;
    EXPECT_LT(std::abs(bench.controller().state().rotation.frequency), step_out);
    EXPECT_FALSE(bench.controller().state().unresponsive);
  }
}

TEST(RotatingController, OnlyTellsWhereItIsNotToRecover) {
  RotatingSettings law;
  law.frequency = 30;
  law.recover = false;
  SwimBench bench(2, law, 1e-3);
  bench.go(2);
  const double above = 1.4 * bench.controller().state().believed_step_out;
  bench.controller().spin(Eigen::Vector3d::UnitX(), above / 3);
  bench.go(1);
  bench.controller().spin(Eigen::Vector3d::UnitX(), above);
  bench.go(2);
  EXPECT_EQ(bench.found.size(), 1u);
  EXPECT_NEAR(bench.controller().state().rotation.frequency,
              std::min(above, bench.controller().state().limit), 1e-9);
}

// A reference that is faster than the frequency lets the robot be waits for it.
TEST(RotatingController, LetsTheReferenceWait) {
  RotatingSettings law;
  law.frequency = 3;  // 0.56 mm/s
  SwimBench bench(4, law, 2e-3);
  bench.go(5);
  bench.path() = {centimeter(), bench.now()};  // 1 mm/s
  const double begin = bench.path().begin;
  double worst = 0;
  bench.go(10, [&](double now, const sim::BodyState& robot) {
    worst = std::max(worst, (robot.position - bench.path().at(now).position).norm());
  });
  EXPECT_GT(bench.path().begin - begin, 2);
  EXPECT_LT(worst, 0.8e-3);
}

// Over the retina, with friction, slip, and what the fluid in the gap does.
TEST(RotatingController, RollsAMagnetAlongAPathOnTheRetina) {
  RigModel model;
  model.robot = control::robot_named("ndfeb_sphere_500um");
  model.eye = optics::model_eye_5_3();
  RotatingSettings law;
  law.mode = control::RotatingMode::roller;
  const double radius = model.eye.surfaces.front().radius - model.robot.semi_axis;
  const auto on_retina = [&](double x, double y) {
    const double top = model.eye_in_world.z() + model.eye.surfaces.front().radius;
    return Eigen::Vector3d(x, y, top - std::sqrt(radius * radius - x * x - y * y));
  };
  std::vector<Eigen::Vector3d> points;
  for (int k = 0; k <= 8; ++k)
    points.push_back(on_retina(-1e-3 + 0.25e-3 * k, 0.3e-3 * std::sin(k * 0.8)));
  SwimBench bench(2, law, 2e-3, model, points.front());
  bench.go(6);
  bench.path() = {control::Trajectory::spline(points, {0.1e-3, 0.2e-3}), bench.now()};
  double sum = 0;
  int count = 0;
  bench.go(bench.path().path.duration(), [&](double now, const sim::BodyState& robot) {
    const Eigen::Vector3d off = robot.position - bench.path().at(now).position;
    sum += off.head<2>().squaredNorm();
    ++count;
  });
  EXPECT_LT(std::sqrt(sum / count), 60e-6);
}

TEST(RotatingController, RefusesAModeThatIsNotTheRobots) {
  RotatingControllerSettings settings;
  settings.law.mode = control::RotatingMode::roller;
  EXPECT_THROW(RotatingController(helix_model(), settings), std::invalid_argument);
  settings.law.mode = control::RotatingMode::helix;
  RigModel soft;
  soft.robot = control::coni_2mm();
  EXPECT_THROW(RotatingController(soft, settings), std::invalid_argument);
  settings.law.frequency = -1;
  EXPECT_THROW(RotatingController(helix_model(), settings), std::invalid_argument);
}

/// The same currents for two helices that are too far from each other to feel each other: what
/// each goes in a second, m, at a frequency (Hz) of a field (T) about x.
std::pair<double, double> two_helices(double frequency, double field, double second_size) {
  std::pair<double, double> went;
  for (const bool second : {false, true}) {
    sim::WorldSettings settings;
    settings.robot = control::robot_named("helix_2mm");
    settings.placement_scatter = 0;
    if (second) {  // its magnet is as strong as the volume makes it
      sim::PlantSample larger;
      larger.size = second_size;
      sim::apply(larger, settings);
      settings.moment_gain = 0.5 / (second_size * second_size * second_size);
    }
    sim::World world(settings, 1);
    world.insert_robot({}, {second ? 2e-3 : -2e-3, second ? 3e-3 : -3e-3, 0});
    const control::FieldCurrents currents = control::uniform_field_currents(
        settings.field.matrix(Eigen::Vector3d::Zero()), control::CurrentLimits::Constant(8, 12));
    control::Rotation rotation{{1, 0, 0}, {0, 1, 0}, 3, field};
    double phase = 0, from = 0;
    for (int k = 0; k < 4000; ++k) {
      const Time now = milliseconds(k);
      if (k == 2000) rotation.frequency = frequency;
      if (k == 3000) from = world.robot(now)->position.x();
      phase += 2 * std::numbers::pi * rotation.frequency * 1e-3;
      world.set_coil_commands(
          now, currents * control::commanded_field(rotation, phase, 1 / (2 * std::numbers::pi * 15),
                                                   1e-3));
    }
    const double gone = world.robot(milliseconds(4000))->position.x() - from;
    (second ? went.second : went.first) = gone;
  }
  return went;
}

// Two robots of one shape, one with half of the magnet: between their step-outs the strong one
// swims and the weak one stays nearly in its place.
TEST(TwoRobots, AreChosenByTheirStepOut) {
  const double field = 1e-3;
  const double strong = control::step_out_frequency(control::robot_named("helix_2mm"), {}, field);
  const auto both = two_helices(0.4 * strong, field, 1);
  EXPECT_NEAR(both.second / both.first, 1, 0.05);
  const auto one = two_helices(0.95 * strong, field, 1);
  EXPECT_GT(one.first, 2 * both.first);
  EXPECT_LT(one.second, 0.2 * one.first);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
