// The camera model of both projections: its lines of sight.
// SPDX-License-Identifier: Apache-2.0
#include "optics/projection/projection_model.h"

#include "tests/optics/support.h"

#include <gtest/gtest.h>

namespace vitreo::optics::detail {
namespace VITREO_TEST_FILE {

TEST(ProjectionModel, ALineOfSightHasAUnitDirectionAndPassesThePointsThatItsPixelShows) {
  const System eye = model_eye_5_3();
  const SingleViewpoint view = fit_single_viewpoint(eye, {}, 7 * kMm);
  const std::optional<ExactProjection> none;
  const std::optional<ExactProjection> exact(std::in_place, eye, Microscope{}, 7 * kMm);
  const ImageScale image;
  for (const auto* projection : {&none, &exact}) {
    const ProjectionModel camera(view, *projection, image);
    for (const Eigen::Vector3d& point :
         {Eigen::Vector3d(0, 0, 4 * kMm), Eigen::Vector3d(3 * kMm, -1 * kMm, 5 * kMm)}) {
      const auto sight = camera.line_of_sight(camera.pixel(point).value());
      ASSERT_TRUE(sight);
      EXPECT_NEAR(sight->direction.norm(), 1, 1e-15);  // rounding
      EXPECT_GT(sight->direction.z(), 0);
      const Eigen::Vector3d off = point - sight->origin;
      EXPECT_LT((off - off.dot(sight->direction) * sight->direction).norm(),
                1e-12);  // m: Newton's end
    }
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics::detail
