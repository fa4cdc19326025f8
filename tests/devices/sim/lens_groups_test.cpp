// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/lens_groups.h"

#include "devices/sim/optics_sample.h"
#include "devices/sim/view.h"
#include "optics/projection/exact_projection.h"
#include "optics/system/prescriptions.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace vitreo::sim {
namespace VITREO_TEST_FILE {

TEST(LensGroups, AGradientLensIsAllThatLiesBetweenVitreousAndAqueous) {
  const auto plain = lens_groups(optics::prescription("navarro_condensing").system);
  ASSERT_TRUE(plain);
  EXPECT_EQ(plain->inner_lens, 2);
  EXPECT_EQ(plain->inner_lens_front, 3);
  EXPECT_EQ(plain->cornea, 5);
  EXPECT_EQ(plain->condensing_lens, 6);
  const auto gradient = lens_groups(optics::prescription("liou_brennan_condensing").system);
  ASSERT_TRUE(gradient);
  EXPECT_EQ(gradient->inner_lens, 2);
  EXPECT_EQ(gradient->inner_lens_front, 4) << "behind the plane at its equator";
  EXPECT_EQ(gradient->cornea, 6);
  EXPECT_EQ(gradient->condensing_lens, 7);
}

TEST(LensGroups, AreThoseOfAnEyeBeforeACondensingLensOnly) {
  EXPECT_FALSE(lens_groups(optics::prescription("navarro").system));
  EXPECT_FALSE(lens_groups(optics::prescription("liou_brennan").system));
  optics::System wet = optics::prescription("navarro_condensing").system;
  wet.surfaces[4].index = 1.336;
  EXPECT_FALSE(lens_groups(wet)) << "a contact lens in water is no condensing lens in air";
}

TEST(LensGroups, OfADrawnBenchMoveAsOne) {
  OpticsSample sample;
  sample.inner_lens_tilt = {0.05, 0};
  const optics::System eye =
      sample.applied_to(optics::prescription("liou_brennan_condensing").system);
  for (int k = 1; k <= eye.size(); ++k)
    EXPECT_EQ(eye.surfaces[static_cast<std::size_t>(k) - 1].placement.is_none(), k < 2 || k > 4)
        << k;
}

/// px at most between where the camera shows points of an eye and where its chief rays lead.
double apart(const optics::System& eye, Eigen::Vector2d& first) {
  LaboratorySettings settings;
  settings.top_image = {14.3e-6, {691.5, 517.5}};
  constexpr double kReach = 9e-3;  // m of aerial image
  const optics::ExactProjection exact(eye, settings.microscope, kReach);
  const View view = eye_view(eye, settings.microscope, settings.top_image, settings.top.size,
                             settings.world.cavity.vertex);
  double most = 0;
  for (const Eigen::Vector3d& point :
       {Eigen::Vector3d(2e-3, -1e-3, 2e-3), Eigen::Vector3d(0, 0, 5e-3),
        Eigen::Vector3d(-2.5e-3, 1.5e-3, 8e-3)}) {
    const auto shown = view.pixel_of(view.point_in_view(settings.world.cavity.vertex + point));
    const auto m = exact.project(point);
    EXPECT_TRUE(shown && m);
    if (!shown || !m) return 1e9;
    if (most == 0) first = *shown;
    most = std::max(most, (*shown - settings.top_image.pixel_from_m(*m)).norm());
  }
  return most;
}

// pixel_of() ends within 0.02 px and lines are interpolated: together below a twentieth.
TEST(LensGroups, WhatTheCameraShowsOfAnEyeOfAnotherBuildIsWhereItsRaysLead) {
  const optics::System believed = optics::prescription("navarro_condensing").system;
  optics::System toric = believed;
  toric.surfaces[4].radius_y = believed.surfaces[4].radius * 1.03;
  toric.surfaces[4].conic_y = believed.surfaces[4].conic;
  toric.surfaces[4].placement.tilt.z() = 0.6;
  Eigen::Vector2d before(0, 0);
  EXPECT_LT(apart(believed, before), 0.05);
  for (const optics::System& eye :
       {toric, optics::prescription("liou_brennan_condensing").system}) {
    Eigen::Vector2d there(0, 0);
    EXPECT_LT(apart(eye, there), 0.05) << eye.size();
    EXPECT_GT((there - before).norm(), 0.5) << "another eye shows another picture";
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::sim
