// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/optics_sample.h"

#include "devices/sim/bench_sample.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <string>

namespace vitreo::sim {
namespace VITREO_TEST_FILE {

TEST(OpticsSample, OfNoSigmasLeavesTheSettingsToTheLastBit) {
  LaboratorySettings settings;
  settings.microscope.pupil_distance = 0.3;
  const LaboratorySettings same = with_optics(settings, sample_optics({}, 7));
  EXPECT_EQ(same.microscope.pupil_distance, settings.microscope.pupil_distance);
  EXPECT_EQ(same.microscope.focus, settings.microscope.focus);
  EXPECT_EQ(same.top_image.pixel, settings.top_image.pixel);
  EXPECT_EQ(same.top_image.center_px, settings.top_image.center_px);
  EXPECT_EQ(same.world.cavity.radius, settings.world.cavity.radius);
  EXPECT_EQ(same.eye.surfaces[0].thickness, settings.eye.surfaces[0].thickness);
}

TEST(OpticsSample, HasTheStatedSigmasOverSeeds) {
  constexpr int kSeeds = 400;
  double lens = 0;
  double pupil = 0;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    const OpticsSample sample = sample_optics(OpticsSigmas::stated(), seed);
    lens += sample.lens_axial * sample.lens_axial / kSeeds;
    pupil += sample.pupil_power / kSeeds;
    EXPECT_GE(sample.pupil_power, 0);
    EXPECT_LE(sample.pupil_power, 4);
    EXPECT_LE(std::abs(sample.retina_depth), 0.9e-3);  // cut at three sigmas
  }
  EXPECT_NEAR(std::sqrt(lens), 0.5e-3, 0.05e-3);
  EXPECT_NEAR(pupil, 2, 0.2);
}

TEST(OpticsSample, WhatWasDrawnIsAmongWhatTheRecordTells) {
  const OpticsSample sample = sample_optics(OpticsSigmas::stated(), 7);
  const auto clock = virtual_clock();
  const auto told_of = [&clock](const OpticsSample& bench) {
    const Laboratory laboratory(with_optics({}, bench), *clock, 7);
    std::map<std::string, double> told;
    for (const auto& [name, value] : laboratory.drawn()) told[name] = value;
    return told;
  };
  const auto told = told_of(sample);
  EXPECT_EQ(told.at("retina_depth_m"), sample.retina_depth);
  EXPECT_EQ(told.at("lens_aside_x_m"), sample.lens_aside.x());
  EXPECT_EQ(told_of({}).count("retina_depth_m"), 0U) << "it stands as believed";
}

TEST(OpticsSample, ADeeperRetinaLeavesTheLensesWhereTheyAre) {
  OpticsSample sample;
  sample.retina_depth = 0.2e-3;
  LaboratorySettings settings;
  const LaboratorySettings off = with_optics(settings, sample);
  const auto lens_in_world = [](const LaboratorySettings& one) {
    return one.world.cavity.vertex.z() + one.eye.vertex(2);
  };
  EXPECT_NEAR(lens_in_world(off), lens_in_world(settings), 1e-12);
  EXPECT_NEAR(off.world.cavity.vertex.z() - settings.world.cavity.vertex.z(), 0.2e-3, 1e-12);
}

TEST(OpticsSample, TheMicroscopeStaysWhereItIsWhenTheCondensingLensMoves) {
  OpticsSample sample;
  sample.lens_axial = 0.4e-3;
  LaboratorySettings settings;
  const LaboratorySettings off = with_optics(settings, sample);
  const auto plane = [](const LaboratorySettings& one) {
    return one.eye.vertex(one.eye.size()) + one.microscope.focus;
  };
  EXPECT_NEAR(plane(off), plane(settings), 1e-12);
}

TEST(OpticsSample, EverySurfaceOfABelievedBenchStaysOnTheAxis) {
  OpticsSample sample;
  EXPECT_TRUE(sample.applied_to(optics::model_eye_5_3()).is_symmetric());
  sample.lens_tilt = {0.03, 0};
  const optics::System turned = sample.applied_to(optics::model_eye_5_3());
  for (int k = 2; k <= 5; ++k) EXPECT_TRUE(turned.surfaces[k - 1].placement.is_none()) << k;
  for (int k = 6; k <= 7; ++k) EXPECT_FALSE(turned.surfaces[k - 1].placement.is_none()) << k;
}

// A telecentric microscope looks through the middle of the pupil; of the stated benches nine in a
// hundred leave it.
TEST(BenchSample, ShowsTheInsideOfTheEyeWhateverTheSeed) {
  LaboratorySettings settings;
  settings.top_image = {14.3e-6, {691.5, 517.5}};
  int anew = 0;
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    const OpticsSample sample = sample_bench(settings, OpticsSigmas::stated(), seed);
    const LaboratorySettings drawn = with_optics(settings, sample);
    EXPECT_TRUE(optics::isopixel_line(drawn.eye, drawn.microscope, {0, 0})) << seed;
    anew += sample.lens_axial != sample_optics(OpticsSigmas::stated(), seed).lens_axial;
  }
  EXPECT_GT(anew, 5);
  EXPECT_LT(anew, 80);
}

TEST(StagePlay, LosesItsBacklashAtAReversalAndComesToRestBesideThePlace) {
  StagePlay backlash({10e-6, 0}, 1);
  EXPECT_EQ(backlash.carried(0), 0);
  EXPECT_NEAR(backlash.carried(100e-6), 95e-6, 1e-12);
  EXPECT_NEAR(backlash.carried(92e-6), 95e-6, 1e-12) << "within the play";
  EXPECT_NEAR(backlash.carried(50e-6), 55e-6, 1e-12);
  StagePlay noisy({0, 2e-6}, 1);
  double sum = 0;
  for (int k = 1; k <= 400; ++k) {
    const double off = noisy.carried(k * 1e-3) - k * 1e-3;
    EXPECT_EQ(noisy.carried(k * 1e-3) - k * 1e-3, off) << "it stands still between two motions";
    sum += off * off / 400;
  }
  EXPECT_NEAR(std::sqrt(sum), 2e-6, 0.3e-6);
  EXPECT_EQ(StagePlay({}, 1).carried(0.123e-3), 0.123e-3);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::sim
