// Plant samples: reproducible, as wide as stated, one stream a parameter; and what is in no model
// of a loop: cores and heat.
// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/plant_sample.h"

#include "devices/sim/laboratory.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <stdexcept>
#include <string>

namespace vitreo::sim {
namespace VITREO_TEST_FILE {

std::map<std::string, double> values(const PlantSample& sample) {
  std::map<std::string, double> all;
  for (const auto& [name, value] : sample.named()) all[name] = value;
  return all;
}

TEST(PlantSample, ASeedIsAMachineAndAnotherSeedIsAnother) {
  const PlantSigmas stated = PlantSigmas::stated();
  EXPECT_EQ(values(sample_plant(stated, 5)), values(sample_plant(stated, 5)));
  const auto one = values(sample_plant(stated, 5)), other = values(sample_plant(stated, 6));
  for (const auto& [name, value] : one) {
    if (name == "jitter_s") continue;
    EXPECT_NE(value, other.at(name)) << name;
  }
}

TEST(PlantSample, WithoutSigmasNothingIsDrawn) {
  WorldSettings before, after;
  apply(sample_plant({}, 5), after);
  EXPECT_EQ(after.medium.kinematic_viscosity, before.medium.kinematic_viscosity);
  EXPECT_EQ(after.robot.mass(), before.robot.mass());
  EXPECT_EQ(after.robot.semi_axis, before.robot.semi_axis);
  EXPECT_EQ(after.coils.delay, before.coils.delay);
  EXPECT_EQ(after.coils.bandwidth, before.coils.bandwidth);
  EXPECT_EQ(after.field.uniform_background(), before.field.uniform_background());
  EXPECT_EQ(sampled_latency(sample_plant({}, 5), 0.08), 0.08);
}

TEST(PlantSample, OneSigmaLeavesTheOtherDrawsAsTheyWere) {
  PlantSigmas stated = PlantSigmas::stated();
  const PlantSample before = sample_plant(stated, 9);
  stated.viscosity = 0;
  const PlantSample after = sample_plant(stated, 9);
  EXPECT_EQ(after.viscosity, 1);
  EXPECT_EQ(after.mass, before.mass);
  EXPECT_EQ(after.background, before.background);
}

TEST(PlantSample, IsAsWideAsStatedAndCutAtThree) {
  const PlantSigmas stated = PlantSigmas::stated();
  double viscosity = 0, background = 0, pixel = 0, eye = 0, tilt = 0, stamp = 0;
  constexpr int kMachines = 2000;
  for (std::uint64_t seed = 1; seed <= kMachines; ++seed) {
    const PlantSample one = sample_plant(stated, seed);
    viscosity += std::pow(one.viscosity - 1, 2) / kMachines;
    background += one.background.squaredNorm() / kMachines;
    pixel += std::pow(one.top_pixel - 1, 2) / kMachines;
    eye += one.eye.squaredNorm() / 3 / kMachines;
    tilt += one.tilt.squaredNorm() / 2 / kMachines;
    stamp += one.stamp * one.stamp / kMachines;
    EXPECT_LE(std::abs(one.coil_delay - 1), 3 * stated.coil_delay + 1e-12);
  }
  // The standard deviation of 2000 draws is known to 1.6 %; here four of that. The cut takes 1.3 %.
  EXPECT_NEAR(std::sqrt(viscosity), stated.viscosity, 0.07 * stated.viscosity);
  EXPECT_NEAR(std::sqrt(background), stated.background, 0.07 * stated.background);
  EXPECT_NEAR(std::sqrt(pixel), stated.pixel, 0.07 * stated.pixel);
  EXPECT_NEAR(std::sqrt(eye), stated.eye, 0.07 * stated.eye);
  EXPECT_NEAR(std::sqrt(tilt), stated.tilt, 0.07 * stated.tilt);
  EXPECT_NEAR(std::sqrt(stamp), stated.stamp, 0.07 * stated.stamp);
}

TEST(PlantSample, TheWorldOfALaboratoryIsItsSample) {
  LaboratorySettings settings;
  settings.sigmas = PlantSigmas::stated();
  const PlantSample sample = sample_plant(settings.sigmas, 11);
  const WorldSettings world = sampled_world(settings, 11);
  EXPECT_NEAR(world.medium.kinematic_viscosity, 500e-6 * sample.viscosity, 1e-12);
  EXPECT_NEAR(world.robot.mass() / settings.world.robot.mass(),
              sample.mass * std::pow(sample.size, 3), 1e-12);
  EXPECT_EQ(world.field.uniform_background(), sample.background);
  const auto clock = virtual_clock();
  Laboratory laboratory(settings, *clock, 11);
  std::map<std::string, double> told;
  for (const auto& [name, value] : laboratory.drawn()) told[name] = value;
  EXPECT_EQ(told.at("viscosity_factor"), sample.viscosity);
  EXPECT_EQ(told.at("moment_factor"), world.moment_gain);
  laboratory.redraw(12);
  EXPECT_EQ(laboratory.machines(), 2);
  EXPECT_NE(laboratory.drawn().front().second, sample.viscosity);
}

// The stamp is late by what was drawn, the frame comes when it would have come anyway.
TEST(PlantSample, TheStampsOfACameraAreOffAndItsFramesAreNot) {
  LaboratorySettings settings;
  settings.sigmas.stamp = 1e-3;
  const auto clock = virtual_clock();
  Laboratory laboratory(settings, *clock, 11);
  const double stamp = sample_plant(settings.sigmas, 11).stamp;
  ASSERT_GT(std::abs(stamp), 1e-5);
  const Frame frame = laboratory.side_camera().grab(from_seconds(1));
  const double exposed = static_cast<double>(frame.number) / settings.side.frame_rate;
  EXPECT_NEAR(to_seconds(frame.exposed) - exposed, stamp, 1e-6);
  EXPECT_NEAR(to_seconds(frame.received) - exposed, settings.side.latency, 1e-6);
}

TEST(PlantSample, AnImpossibleSigmaIsNamed) {
  PlantSigmas wrong;
  wrong.viscosity = 0.5;
  EXPECT_THROW(sample_plant(wrong, 1), std::invalid_argument);
}

/// The field of coil 1, as a current, after it was brought from one set-point to the next for half
/// a second each.
double effective_after(const CoilBankSettings& settings, std::initializer_list<double> set_points) {
  CoilBank bank(settings, 8);
  Time now{};
  for (const double amperes : set_points) {
    control::Currents command = control::Currents::Zero(8);
    command[0] = amperes;
    bank.command(now, command);
    for (int k = 0; k < 500; ++k, now += std::chrono::milliseconds(1)) bank.step(now);
  }
  return bank.effective()[0];
}

TEST(CoilBank, ACoreSaturatesAndOneWithoutSaturationDoesNot) {
  CoilBankSettings settings;
  settings.supply_voltage = 200;
  EXPECT_NEAR(effective_after(settings, {50}), 50, 1e-6);
  settings.saturation = 57;
  EXPECT_NEAR(effective_after(settings, {12}), 12, 0.01)
      << "a hundredth of the knee's fourth power";
  EXPECT_NEAR(effective_after(settings, {57}), 57 / std::pow(2, 0.25), 0.01);
}

TEST(CoilBank, ACoreRemembersFromWhereItCameAndHasNoBacklash) {
  CoilBankSettings settings;
  settings.remanence = 40e-3;
  settings.reversal_slope = 0.01;
  EXPECT_NEAR(effective_after(settings, {10, 0}), 40e-3, 1e-6) << "what is left at zero current";
  EXPECT_NEAR(effective_after(settings, {-10, 0}), -40e-3, 1e-6);
  // A small change goes through but for a hundredth.
  const double before = effective_after(settings, {10, 5}),
               after = effective_after(settings, {10, 5, 5.02});
  EXPECT_NEAR(after - before, 0.02 * 0.99, 1e-6);
}

TEST(CoilBank, AWarmCoilMakesLessField) {
  CoilBankSettings settings;
  settings.gain_temperature_coefficient = -2e-4;
  settings.heat_capacity = 1;  // so that half a second warms it
  const double cold = effective_after(settings, {0.001}), warm = effective_after(settings, {6});
  EXPECT_NEAR(cold, 0.001, 1e-6);
  EXPECT_LT(warm, 6 * (1 - 2e-4 * 5));
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::sim
