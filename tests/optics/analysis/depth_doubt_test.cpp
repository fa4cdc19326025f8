// Depth doubt against localizations through eyes and of bodies that are not the believed ones.
// SPDX-License-Identifier: Apache-2.0
#include "optics/analysis/depth_doubt.h"

#include "optics/calibration/camera_calibration.h"
#include "optics/pose/pose.h"
#include "optics/projection/single_viewpoint.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

constexpr double kReach = 7e-3;
const Eigen::Vector3d kAxis(1, 0, 0);

PoseSettings through(const System& eye) {
  PoseSettings settings;
  settings.projection = fit_single_viewpoint(eye, {}, kReach);
  settings.max_residual_px = 1e3;
  return settings;
}

/// m: the depth that is found less the true one.
double depth_error(const PoseSettings& truth, const PoseSettings& believed, double z) {
  const auto shown = project_spheroid(truth, {0, 0, z}, kAxis);
  if (!shown) return NAN;
  const auto found = locate(believed, *shown, EllipseCovariance::Identity(), kAxis, {0, 0, z});
  return found ? found->position_in_eye.z() - z : NAN;
}

TEST(DepthDoubt, ABodyThatIsLargerByOneSigmaIsFoundNearerByOneSigma) {
  const PoseSettings believed = through(model_eye_5_3());
  PoseSettings truth = believed;
  truth.robot.semi_axis *= 1.01;
  truth.robot.semi_radius *= 1.01;
  DepthDoubt doubt;
  doubt.viewpoint = believed.projection.viewpoint;
  doubt.scale = 0.01;
  for (const double z : {1e-3, 4e-3, 7e-3})
    EXPECT_NEAR(std::abs(depth_error(truth, believed, z)), doubt.sigma_z(z), 0.1 * doubt.sigma_z(z))
        << z;
}

// Table 5.1, one parameter at a time: the root of the sum of squares.
TEST(DepthDoubt, OfAnUncertainEyeIsWhatLocalizationThroughSuchEyesIsWrongBy) {
  const Prescription eye = prescription("model_eye_5_3");
  const PoseSettings believed = through(eye.system);
  DepthDoubt doubt;
  doubt.viewpoint = believed.projection.viewpoint;
  doubt.eye = viewpoint_shifts(eye, table_5_1());
  DepthDoubt after = doubt;
  after.calibrated_at = 0.5e-3;
  for (const double z : {1e-3, 4e-3}) {
    double plain = 0;
    double calibrated = 0;
    for (const Uncertainty& one : applicable(table_5_1(), eye)) {
      const PoseSettings truth = through(perturbed(eye, one, 1).system);
      plain += std::pow(depth_error(truth, believed, z), 2);
      const auto shown = project_spheroid(truth, {0, 0, 0.5e-3}, kAxis);
      ASSERT_TRUE(shown);
      const PoseSettings corrected =
          calibrate_pose(believed, *shown, kAxis, 0.5e-3).applied(believed);
      calibrated += std::pow(depth_error(truth, corrected, z), 2);
    }
    EXPECT_NEAR(std::sqrt(plain), doubt.sigma_z(z), 0.25 * doubt.sigma_z(z)) << z;
    EXPECT_NEAR(std::sqrt(calibrated), after.sigma_z(z), 0.3 * after.sigma_z(z) + 5e-6) << z;
  }
}

TEST(DepthDoubt, LiesAlongTheLineOfSight) {
  DepthDoubt doubt;
  doubt.viewpoint = 11e-3;
  doubt.scale = 0.01;
  const Eigen::Vector3d point(3e-3, 0, 1e-3);
  const Eigen::Matrix3d covariance = doubt.covariance(point);
  EXPECT_NEAR(std::sqrt(covariance(2, 2)), 1e-4, 1e-9);
  EXPECT_NEAR(covariance(0, 2) / covariance(2, 2), -0.3, 1e-9);
  EXPECT_EQ(DepthDoubt{}.covariance(point), Eigen::Matrix3d::Zero()) << "nothing is doubted";
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
