// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/optics_sample.h"

#include <gtest/gtest.h>

#include <cmath>

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

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::sim
