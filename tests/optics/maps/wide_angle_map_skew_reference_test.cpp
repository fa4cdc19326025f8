// WideAngleMap without rotational symmetry against bundles that are aimed and focused by a plain
// loop: a microscope that is tilted and decentered, and an eye whose cornea has slipped.
// SPDX-License-Identifier: Apache-2.0
#include "optics/maps/wide_angle_map.h"
#include "tests/optics/maps/wide_angle_reference.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <stdexcept>
#include <string>
#include <tuple>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

using Eigen::Vector3d;
using reference::Case;
using reference::in_field;
using reference::seen;

Case small(Case c) {
  c.settings.max_angle = 0.15;
  c.settings.angle_nodes = 9;
  return c;
}
Case skew() {
  return small(reference::make("skew", false, 95e-3, {0.3e-3, -0.4e-3}, {-0.03, 0.02}));
}
Case slipped() {
  Case c = small(reference::make("slipped", false));
  for (int i : {3, 4}) c.system.surfaces[i].placement.decenter = {0.2e-3, -0.3e-3, 0.01e-3};
  c.system.surfaces[6].placement.tilt = {0.03, -0.04, 0};
  return c;
}

void expect_refusal(const std::function<void()>& act) {
  try {
    act();
    ADD_FAILURE() << "not refused";
  } catch (const std::invalid_argument& error) {
    EXPECT_NE(std::string(error.what()).find("microscope"), std::string::npos) << error.what();
  }
}

void expect_map(const Case& c) {
  const WideAngleMap map(c.system, c.settings);
  EXPECT_FALSE(map.symmetric());
  EXPECT_DOUBLE_EQ(map.max_angle(), c.settings.max_angle);
  EXPECT_LT(map.tail(), 5e-9);
  EXPECT_DOUBLE_EQ(map.edge(), 1e-9 + 4 * map.tail());
  const double error = c.settings.microscope ? 9e-9 : 2e-14;
  for (const auto& [angle, azimuth, depth] :
       {std::tuple{0.11, 0.7, 2.9e-3}, std::tuple{0.14, 2.5, 0.1e-3}, std::tuple{0.09, 4.1, 6.1e-3},
        std::tuple{0.003, 5.3, 4.4e-3}, std::tuple{0.12, 5.7, 3.6e-3}}) {
    const Vector3d point = in_field(c.system, angle, azimuth, depth);
    const AerialPoint mine = seen(c.system, c.settings, point);
    const auto traced = map.traced_image(point);
    ASSERT_TRUE(traced);
    EXPECT_NEAR(traced->focus, mine.focus, error) << azimuth;
    EXPECT_LT((traced->m - mine.m).norm(), 0.3 * error) << azimuth;
    const auto image = map.image(point);
    ASSERT_TRUE(image);
    EXPECT_NEAR(image->focus, traced->focus, 3 * map.tail()) << azimuth;
    EXPECT_LT((image->m - traced->m).norm(), 2 * map.tail()) << azimuth;
    const auto back = map.point(*image);
    ASSERT_TRUE(back);
    EXPECT_LT((*back - point).norm(), 1e-10) << azimuth;
    const auto found = map.point(mine);
    ASSERT_TRUE(found);
    EXPECT_LT((*found - point).norm(), 8 * map.tail() + 4 * error) << azimuth;
  }
  // its bounds, and what lies beyond them
  const double a = c.settings.max_angle;
  const double d = c.settings.max_depth;
  const double near = 0.3 * map.edge();
  const double far = 5 * map.edge();
  const double arm = reference::vertex_z(c.system, 3);
  for (const double azimuth : {2.2, 5.1}) {
    EXPECT_TRUE(map.image(in_field(c.system, a + near / arm, azimuth, 1e-3)));
    EXPECT_FALSE(map.image(in_field(c.system, a + far / arm, azimuth, 1e-3)));
    EXPECT_TRUE(map.image(in_field(c.system, 0.1, azimuth, d + near)));
    EXPECT_FALSE(map.image(in_field(c.system, 0.1, azimuth, d + far)));
    EXPECT_TRUE(map.image(in_field(c.system, 0.1, azimuth, -near)));
    EXPECT_FALSE(map.image(in_field(c.system, 0.1, azimuth, -far)));
    EXPECT_TRUE(map.traced_image(in_field(c.system, 1.1 * a, azimuth, d + 0.5e-3)));
    const AerialPoint beyond =
        seen(c.system, c.settings, in_field(c.system, a * 1.05, azimuth, 1e-3));
    EXPECT_FALSE(map.point(beyond));
    const AerialPoint deeper =
        seen(c.system, c.settings, in_field(c.system, a * 0.5, azimuth, d + 0.2e-3));
    EXPECT_FALSE(map.point(deeper));
  }
  // it has no meridional plane
  expect_refusal([&] { map.at({0.1, 1e-3}); });
  expect_refusal([&] { map.find(14e-3, -2e-3); });
  expect_refusal([&] { map.plane_point({0.1, 1e-3}); });
  expect_refusal([&] { map.position_of({1e-3, 2e-3}); });
}

TEST(WideAngleMapSkewReference, sees_by_a_microscope_that_is_tilted_and_decentered) {
  expect_map(skew());
}
TEST(WideAngleMapSkewReference, sees_through_a_cornea_that_has_slipped) { expect_map(slipped()); }

// Decentered alone: a pupil at a distance sees from the side, one at infinity does not.
TEST(WideAngleMapSkewReference, sees_by_a_microscope_that_is_decentered_and_not_tilted) {
  expect_map(small(reference::make("decentered", false, 95e-3, {0.4e-3, -0.5e-3})));
}
// So far that the plane in focus is not where its axis' height is: cosines of the tilt count.
TEST(WideAngleMapSkewReference, focuses_a_microscope_that_is_far_tilted) {
  Case c = small(reference::make("tilted", false, 95e-3, {0.2e-3, -0.3e-3}, {0.16, -0.11}));
  c.settings.max_angle = 0.1;
  c.system.stop->radius = 5e-3;  // no shadow
  const WideAngleMap map(c.system, c.settings);
  for (const double azimuth : {0.7, 2.5, 4.1}) {
    const Vector3d point = in_field(c.system, 0.09, azimuth, 2.9e-3);
    const AerialPoint mine = seen(c.system, c.settings, point);
    const auto traced = map.traced_image(point);
    ASSERT_TRUE(traced);
    EXPECT_NEAR(traced->focus, mine.focus, 9e-9) << azimuth;
    EXPECT_LT((traced->m - mine.m).norm(), 9e-9) << azimuth;
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
