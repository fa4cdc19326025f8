// SPDX-License-Identifier: Apache-2.0
#include "optics/pose/pose.h"

#include "optics/pose/silhouette.h"
#include "tests/optics/pose/exact_silhouette.h"
#include "tests/optics/pose/pose_support.h"
#include "tests/optics/support.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

std::vector<Eigen::Vector3d> grid() {
  std::vector<Eigen::Vector3d> places;
  for (double x : {-4.0, -1.0, 0.0, 2.5, 4.0}) {
    for (double y : {-3.0, 0.0, 1.0}) {
      for (double z : {2.0, 5.0, 8.0}) places.push_back(Eigen::Vector3d(x, y, z) * kMm);
    }
  }
  return places;
}

TEST(Pose, LocateReturnsThePlaceThatWasProjected) {
  PoseSettings settings = default_settings();
  settings.projection.max_m =
      8 * kMm;  // the grid's corners at 8 mm lie further out than the square
  for (const Eigen::Vector3d& axis : {kAlongX, kAlongZ, kOblique}) {
    for (const Eigen::Vector3d& place : grid()) {
      const auto shown = project_spheroid(settings, place, axis);
      ASSERT_TRUE(shown) << place.transpose();
      const auto found =
          locate(settings, *shown, tracker_noise(), axis,
                 place + Eigen::Vector3d(0.3, -0.2, place.z() < 5 * kMm ? 0.5 : -0.5) * kMm);
      ASSERT_TRUE(found) << place.transpose();
      EXPECT_LT((found->position_in_eye - place).norm(),
                0.01 * kUm);  // what the solver's tolerances leave
      EXPECT_LT(found->residual_px, 1e-3);
    }
  }
}

// The derivatives against the estimator itself, with a body and a camera that are really larger.
TEST(Pose, ItsSensitivityIsWhatAWrongSizeOrPixelDoes) {
  const PoseSettings settings = default_settings();
  constexpr double kPart = 2e-3;
  for (const Eigen::Vector3d& axis : {kAlongX, kOblique}) {
    const Eigen::Vector3d place(1.5 * kMm, -1 * kMm, 5 * kMm);
    const auto known = pose_sensitivity(settings, place, axis);
    ASSERT_TRUE(known);
    PoseSettings larger = settings;
    larger.robot.semi_axis *= 1 + kPart;
    larger.robot.semi_radius *= 1 + kPart;
    PoseSettings coarser = settings;
    coarser.image.pixel *= 1 + kPart;
    const auto moved = [&](const PoseSettings& real) -> Eigen::Vector3d {
      const auto shown = project_spheroid(real, place, axis);
      const auto found = locate(settings, *shown, tracker_noise(), axis, place);
      return (found->position_in_eye - place) / kPart;
    };
    const Eigen::Vector3d by_size = moved(larger), by_pixel = moved(coarser);
    EXPECT_LT((known->size - by_size).norm(), 0.03 * by_size.norm()) << by_size.transpose();
    EXPECT_LT((known->pixel - by_pixel).norm(), 0.03 * by_pixel.norm()) << by_pixel.transpose();
    EXPECT_GT(by_size.z(), 10 * kMm)
        << "a hundredth of the size is a tenth of a millimeter, and more";
    EXPECT_LT(by_pixel.z(), -10 * kMm) << "what looks smaller seems to be farther away";
  }
}

TEST(Pose, FirstGuessIsAGoodStart) {
  PoseSettings settings = default_settings();
  settings.projection.max_m = 8 * kMm;
  for (const Eigen::Vector3d& axis : {kAlongX, kAlongZ, kOblique}) {
    for (const Eigen::Vector3d& place : grid()) {
      const auto shown = project_spheroid(settings, place, axis);
      const auto guess = first_guess(settings, *shown, axis);
      ASSERT_TRUE(guess);
      EXPECT_LT((*guess - place).norm(),
                60 * kUm);  // the ellipse's center is not the image of the robot's center
      const auto found = locate(settings, *shown, tracker_noise(), axis, *guess);
      ASSERT_TRUE(found);
      EXPECT_LT((found->position_in_eye - place).norm(), 0.01 * kUm);
    }
  }
}

TEST(Pose, ConvergesFromMillimetresAway) {
  const PoseSettings settings = default_settings();
  const Eigen::Vector3d place(3 * kMm, 0, 7 * kMm);
  const auto shown = project_spheroid(settings, place, kAlongX);
  for (const Eigen::Vector3d& start :
       {Eigen::Vector3d(-3, 1, 2), Eigen::Vector3d(0, 0, 9), Eigen::Vector3d(0, 0, 0.5)}) {
    const auto found = locate(settings, *shown, tracker_noise(), kAlongX, start * kMm);
    ASSERT_TRUE(found) << start.transpose();
    EXPECT_LT((found->position_in_eye - place).norm(), 0.01 * kUm);
  }
}

TEST(Pose, AxisSenseAndLengthAndAngleByPiDoNotMatter) {
  const PoseSettings settings = default_settings();
  const Eigen::Vector3d place(2 * kMm, 1 * kMm, 4 * kMm);
  EllipseVector shown = *project_spheroid(settings, place, kOblique);
  EXPECT_LT((*project_spheroid(settings, place, -3 * kOblique) - shown).norm(),
            1e-9);  // px; rounding
  for (double turns : {-1.0, 1.0, 2.0}) {
    EllipseVector turned = shown;
    turned[4] += turns * std::numbers::pi;
    const auto found = locate(settings, turned, tracker_noise(), kOblique, place);
    ASSERT_TRUE(found);
    EXPECT_LT((found->position_in_eye - place).norm(), 0.01 * kUm);
  }
}

TEST(Pose, ASphereAndARobotSeenEndOnHaveNoAngleAndAreFoundAllTheSame) {
  PoseSettings settings = default_settings();
  const Eigen::Vector3d on_axis(0, 0, 4 * kMm);
  EllipseVector shown = *project_spheroid(settings, on_axis, kAlongZ);
  EXPECT_NEAR(shown[2], shown[3], 1e-6);  // px; a circle
  shown[4] = 1.234;                       // so a tracker's angle is anything
  auto found = locate(settings, shown, tracker_noise(), kAlongZ,
                      on_axis + Eigen::Vector3d(0.1, 0.1, -0.3) * kMm);
  ASSERT_TRUE(found);
  EXPECT_LT((found->position_in_eye - on_axis).norm(), 0.01 * kUm);
  EXPECT_TRUE(found->covariance.allFinite());
  settings.robot = {0.25 * kMm, 0.25 * kMm};  // the NdFeB sphere of section 5.5
  const Eigen::Vector3d place(3 * kMm, -1 * kMm, 6 * kMm);
  shown = *project_spheroid(settings, place, kAlongX);
  found = locate(settings, shown, tracker_noise(), kAlongX,
                 place + Eigen::Vector3d(0.2, 0.2, 0.5) * kMm);
  ASSERT_TRUE(found);
  EXPECT_LT((found->position_in_eye - place).norm(),
            0.05 * kUm);  // a small sphere's depth is the least determined
}

TEST(Pose, TheModelsEllipseIsTheLeastSquaresEllipseOfItsContour) {
  PoseSettings settings = default_settings();
  settings.projection.max_m = 8 * kMm;
  settings.contour_points = kExactContourPoints;
  const detail::Circle circle(kExactContourPoints);
  for (const Eigen::Vector3d& axis : {kAlongX, kAlongZ, Eigen::Vector3d(kOblique.normalized())}) {
    for (const Eigen::Vector3d& place : grid()) {
      detail::Contour<double> points;
      ASSERT_TRUE(detail::project_contour(settings, circle, place, axis, points));
      ExactContour contour;
      for (int i = 0; i < kExactContourPoints; ++i) contour.col(i) = points[i];
      PoseSettings coarse = settings;
      coarse.contour_points = 24;
      const EllipseVector shown = *project_spheroid(coarse, place, axis);
      for (bool orthogonal : {false, true}) {
        const EllipseVector fit = fit_ellipse(contour, shown, orthogonal);
        // 0.03 px is 3 um of depth; the two ways of counting distance differ by that much, since no
        // silhouette is an ellipse.
        EXPECT_LT((fit - shown).head<4>().cwiseAbs().maxCoeff(), 0.03)
            << place.transpose() << " " << orthogonal;
      }
    }
  }
}

TEST(Pose, CovarianceIsWhatNoiseDoes) {
  const PoseSettings settings = default_settings();
  const Eigen::Vector3d place(3 * kMm, 1 * kMm, 5 * kMm);
  const EllipseVector shown = *project_spheroid(settings, place, kOblique);
  EllipseCovariance covariance = tracker_noise();
  covariance(2, 3) = covariance(3, 2) = 0.02;  // blur makes both axes grow
  covariance(0, 2) = covariance(2, 0) = -0.01;
  const EllipseCovariance root = covariance.llt().matrixL();
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  constexpr int kTrials = 3000;
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  for (int i = 0; i < kTrials; ++i) {
    const EllipseVector noise =
        EllipseVector::NullaryExpr([&](Eigen::Index) { return normal(random); });
    const auto found = locate(settings, shown + root * noise, covariance, kOblique, place);
    ASSERT_TRUE(found);
    const Eigen::Vector3d off = found->position_in_eye - place;
    spread += off * off.transpose() / kTrials;
  }
  const Eigen::Matrix3d predicted =
      locate(settings, shown, covariance, kOblique, place)->covariance;
  const Eigen::Matrix3d whiten =
      predicted.llt().matrixL().solve(Eigen::Matrix3d::Identity()).eval();
  const Eigen::Vector3d ratio =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(whiten * spread * whiten.transpose())
          .eigenvalues();
  // The variance of 3000 draws scatters by sqrt(2/3000) = 2.6 %; the extreme of three directions by
  // some 4 sigma.
  EXPECT_GT(ratio.minCoeff(), 0.88);
  EXPECT_LT(ratio.maxCoeff(), 1.12);
}

TEST(Pose, DepthNoiseIsWhatTheFactsSay) {
  // Facts on optics, 9: 0.2 px on the full axes cost 20 um of depth lying along x and 31 along z,
  // in mid-square.
  const PoseSettings settings = default_settings();
  EllipseCovariance covariance = EllipseCovariance::Zero();
  covariance(2, 2) = covariance(3, 3) = 0.01;  // of semi-axes
  const Eigen::Vector3d place(0, 0, 5 * kMm);
  const auto depth_error = [&](const Eigen::Vector3d& axis) {
    return std::sqrt(
        locate(settings, *project_spheroid(settings, place, axis), covariance, axis, place)
            ->covariance(2, 2));
  };
  EXPECT_NEAR(depth_error(kAlongX), 20 * kUm,
              2 * kUm);  // two digits printed, and they averaged the square
  EXPECT_NEAR(depth_error(kAlongZ), 31 * kUm, 3 * kUm);
}

TEST(Pose, AnEllipseThatTheRobotCannotShowIsNothing) {
  const PoseSettings settings = default_settings();
  const Eigen::Vector3d place(0, 0, 5 * kMm);
  EllipseVector seen = *project_spheroid(settings, place, kAlongX);
  seen[2] *= 3;  // far too slender: residual above the limit
  EXPECT_FALSE(locate(settings, seen, tracker_noise(), kAlongX, place));
  seen = *project_spheroid(settings, place, kAlongX);
  EXPECT_FALSE(locate(settings, seen, tracker_noise(), kAlongX,
                      {0, 0, 19 * kMm}));  // start in the lens: no contour
  seen[2] *= 0.3;                          // as small as if it were behind the retina
  seen[3] *= 0.3;
  EXPECT_FALSE(locate(settings, seen, tracker_noise(), kAlongX, place));
  EXPECT_FALSE(first_guess(settings, seen, kAlongX));
  seen[2] *= 100;
  seen[3] *= 100;
  EXPECT_FALSE(first_guess(settings, seen, kAlongX));
  seen[0] = 5000;  // outside the field
  EXPECT_FALSE(first_guess(settings, seen, kAlongX));
}

TEST(Pose, SpheroidsOutsideTheProjectionShowNothing) {
  const PoseSettings settings = default_settings();
  EXPECT_FALSE(project_spheroid(settings, {0, 0, -1 * kMm}, kAlongX));
  EXPECT_FALSE(project_spheroid(settings, {0, 0, 16 * kMm}, kAlongX));
  EXPECT_FALSE(project_spheroid(settings, {9 * kMm, 0, 5 * kMm}, kAlongX));
  PoseSettings huge = settings;
  huge.robot = {30 * kMm, 30 * kMm};  // holds the viewpoint
  EXPECT_FALSE(project_spheroid(huge, {0, 0, 5 * kMm}, kAlongX));
}

// A robot on the retina that is 3 % smaller than it is believed to be looks farther away than the
// retina: the size goes with the inverse of the distance from the viewpoint.
TEST(Pose, ARobotIsFoundBehindTheRetinaWhereThatIsAllowed) {
  PoseSettings truth = default_settings();
  truth.robot.semi_axis *= 0.97;
  truth.robot.semi_radius *= 0.97;
  const Eigen::Vector3d place(1 * kMm, -0.5 * kMm, 0.25 * kMm);
  const auto shown = project_spheroid(truth, place, kAlongX);
  ASSERT_TRUE(shown);
  PoseSettings settings = default_settings();
  const double farther = (settings.projection.viewpoint - place.z()) * (1 / 0.97 - 1);
  ASSERT_GT(farther, 0.3 * kMm);
  EXPECT_FALSE(locate(settings, *shown, tracker_noise(), kAlongX, place));
  settings.behind_retina = 2 * kMm;
  const auto found = locate(settings, *shown, tracker_noise(), kAlongX, place);
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->position_in_eye.z(), place.z() - farther, 0.05 * kMm);
  EXPECT_LT(found->residual_px, 0.05);
  const auto guess = first_guess(settings, *shown, kAlongX);
  ASSERT_TRUE(guess);
  EXPECT_LT((*guess - found->position_in_eye).norm(), 0.1 * kMm);
  settings.behind_retina = 0.1 * kMm;
  EXPECT_FALSE(locate(settings, *shown, tracker_noise(), kAlongX, place));
  settings.behind_retina = -1e-9;
  EXPECT_THROW(locate(settings, *shown, tracker_noise(), kAlongX, place), std::invalid_argument);
}

TEST(Pose, BadArgumentsAreNamed) {
  const PoseSettings settings = default_settings();
  const Eigen::Vector3d place(0, 0, 5 * kMm), nowhere(0, kNan, 0);
  const EllipseVector seen = *project_spheroid(settings, place, kAlongX);
  const EllipseCovariance noise = tracker_noise();
  for (int i = 0; i < 5; ++i) {
    EllipseVector bad = seen;
    bad[i] = kNan;
    expect_refused("observed", [&] { locate(settings, bad, noise, kAlongX, place); });
    expect_refused("observed", [&] { first_guess(settings, bad, kAlongX); });
  }
  EllipseVector negative = seen;
  negative[3] = -1;
  expect_refused("observed", [&] { locate(settings, negative, noise, kAlongX, place); });
  EllipseCovariance bad = noise;
  bad(1, 1) = -1;
  expect_refused("covariance", [&] { locate(settings, seen, bad, kAlongX, place); });
  bad = noise;
  bad(0, 1) = 1;
  expect_refused("covariance", [&] { locate(settings, seen, bad, kAlongX, place); });
  expect_refused("axis_in_eye", [&] { locate(settings, seen, noise, {0, 0, 0}, place); });
  expect_refused("axis_in_eye", [&] { project_spheroid(settings, place, nowhere); });
  expect_refused("start_in_eye", [&] { locate(settings, seen, noise, kAlongX, nowhere); });
  expect_refused("position_in_eye", [&] { project_spheroid(settings, nowhere, kAlongX); });
}

TEST(Pose, CheckNamesTheSetting) {
  const auto refused = [](const std::string& name, auto spoil) {
    PoseSettings settings = default_settings();
    EXPECT_NO_THROW(settings.check());
    spoil(settings);
    expect_refused(name, [&] { settings.check(); });
  };
  refused("semi_axis", [](PoseSettings& s) { s.robot.semi_axis = 0; });
  refused("semi_radius", [](PoseSettings& s) { s.robot.semi_radius = kNan; });
  refused("angle_weight", [](PoseSettings& s) { s.angle_weight = -1; });
  refused("contour_points", [](PoseSettings& s) { s.contour_points = 65; });
  refused("contour_points", [](PoseSettings& s) { s.contour_points = 4; });
  refused("max_residual_px", [](PoseSettings& s) { s.max_residual_px = kNan; });
  refused("viewpoint", [](PoseSettings& s) { s.projection = {}; });
  refused("pixel", [](PoseSettings& s) { s.image.pixel = -1; });
}

TEST(Pose, LocateNeedsFewStepsFromTheFrameBefore) {  // what a frame costs in time, the bench says
  const PoseSettings settings = default_settings();
  const Eigen::Vector3d place(3 * kMm, 0, 6 * kMm);
  EllipseVector seen = *project_spheroid(settings, place, kAlongX);
  seen[2] += 0.3;  // a residual that does not vanish, as in life
  const auto found =
      locate(settings, seen, tracker_noise(), kAlongX, place + Eigen::Vector3d(1, -1, 2) * 1e-4);
  ASSERT_TRUE(found);
  EXPECT_LE(found->iterations, 4) << "three today";
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
