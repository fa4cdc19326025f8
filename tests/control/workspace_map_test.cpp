// Workspace maps against the published capability of the OctoMag.
// SPDX-License-Identifier: Apache-2.0
#include "control/workspace_map.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

TEST(WorkspaceMap, lists_the_places_with_x_fastest_and_the_corners_at_the_ends) {
  MapRequest request;
  request.points = {3, 2, 1};
  const auto map = workspace_map(CoilField::octomag(), request);
  ASSERT_EQ(map.size(), 6U);
  EXPECT_EQ(map[1].position, Eigen::Vector3d(0, -10e-3, -10e-3));
  EXPECT_EQ(map[5].position, Eigen::Vector3d(10e-3, 10e-3, -10e-3));
}

TEST(WorkspaceMap, reaches_at_the_center_about_what_is_published_and_less_with_less_current) {
  MapRequest request;
  request.low = request.high = {0, 0, 0};
  request.points = {1, 1, 1};
  request.field = {20e-3, 0, 0};
  const MapPoint twelve = workspace_map(CoilField::octomag(), request)[0];
  request.limits.setConstant(8);
  const MapPoint eight = workspace_map(CoilField::octomag(), request)[0];
  // Facts 1.4 by linear programmes: 12 A 57 mT homogeneous and 1.28 T/m along the worst axis at
  // m||x; least norm reaches less (it wastes nothing but corners) and frees the gradients across
  // the force: a third either way.
  EXPECT_NEAR(twelve.field, 57e-3, 19e-3);
  EXPECT_NEAR(twelve.force, 1.0, 0.35);
  EXPECT_LT(eight.force, twelve.force);
  EXPECT_NEAR(eight.field, twelve.field * 8 / 12, 1e-12);
  EXPECT_GT(twelve.condition, 2);
  EXPECT_LT(twelve.condition, 13);
}

TEST(WorkspaceMap, shows_zeros_where_the_model_ends_or_a_freedom_is_lost) {
  MultipoleField::Sources uniform{{{0, 0, 0}, {0, 0, 1}, {1e-3}, {}}};
  const Region small{Eigen::Vector3d::Constant(-1e-3), Eigen::Vector3d::Constant(1e-3)};
  MapRequest request;
  request.limits.setConstant(8, 12);
  const FieldModel model(
      MultipoleField(std::vector<MultipoleField::Sources>(8, uniform), {}, small));
  for (const MapPoint& point : workspace_map(model, request)) {
    EXPECT_EQ(point.field, 0);
    EXPECT_TRUE(std::isinf(point.condition));
  }
  request.points.x() = 0;
  EXPECT_THROW(workspace_map(model, request), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
