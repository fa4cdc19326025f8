// The spheroid's ellipse that stands for a cylinder's.
// SPDX-License-Identifier: Apache-2.0
#include "optics/pose/equivalent_ellipse.h"

#include "optics/pose/pose.h"
#include "optics/system/prescriptions.h"

#include <gtest/gtest.h>

#include <cmath>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

struct Views {
  ObjectPoseSettings body;
  PoseSettings round;
};

Views views(double half_length, double radius) {
  Microscope microscope;
  microscope.focus = 12.3e-3;
  Views made;
  made.body.exact.emplace(model_eye_5_3(), microscope, 8e-3);
  made.body.object = cylinder(half_length, radius);
  made.round.exact = made.body.exact;
  made.round.image = made.body.image;
  made.round.robot = {half_length, radius};
  return made;
}

// (5.15) on the converted ellipse has the cylinder where it is; on its own, elsewhere by far.
TEST(EquivalentEllipse, ACylinderIsFoundByTheLocalizationOfASpheroid) {
  for (const auto& [half, radius] : {std::pair{0.5e-3, 0.25e-3}, {0.15e-3, 0.5e-3}}) {
    const Views view = views(half, radius);
    double own = 0;
    for (int i = 0; i < 12; ++i) {
      const double turn = 0.7 * i;
      const Eigen::Vector3d at(3e-3 * std::cos(turn), 3e-3 * std::sin(turn), 2e-3 + 0.5e-3 * i);
      const Eigen::Vector3d axis(std::cos(0.4 * i), 0.2, std::sin(0.4 * i));
      const auto seen = project_object(view.body, {at, orientation_along(axis)});
      ASSERT_TRUE(seen);
      const auto converted = as_of_spheroid(view.body, *seen, axis);
      ASSERT_TRUE(converted);
      const EllipseCovariance noise = 0.01 * EllipseCovariance::Identity();
      const auto found = locate(view.round, *converted, noise, axis, at);
      ASSERT_TRUE(found) << i;
      EXPECT_LT((found->position_in_eye - at).norm(), 10e-6) << half << " " << i;
      const auto taken = locate(view.round, *seen, noise, axis, at);
      if (taken) own = std::max(own, (taken->position_in_eye - at).norm());
    }
    EXPECT_GT(own, 0.5e-3);
  }
}

TEST(EquivalentEllipse, OfASpheroidItIsItsOwn) {
  Views view = views(1e-3, 0.5e-3);
  view.body.object = ellipsoid({0.5e-3, 0.5e-3, 1e-3});
  const Eigen::Vector3d at(1e-3, 2e-3, 4e-3), axis(1, 0, 0.3);
  const auto seen = project_object(view.body, {at, orientation_along(axis)});
  ASSERT_TRUE(seen);
  const auto same = as_of_spheroid(view.body, *seen, axis, at);
  ASSERT_TRUE(same);
  EXPECT_LT((*same - *seen).norm(), 1e-9);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
