// Cameras from point pairs, and the pose localizer from one look at the robot on the known retina.
// SPDX-License-Identifier: Apache-2.0
#include "optics/calibration/camera_calibration.h"

#include "tests/optics/pose/pose_support.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <vector>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

CameraFit a_camera() {
  CameraFit camera;
  camera.image.pixel = 14.1e-6;
  camera.image.center_px = {700, 510};
  camera.rotation = 0.05;
  return camera;
}

std::vector<PointPair> grid(const CameraFit& camera, double noise_px = 0, unsigned seed = 1) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal(0, 1);
  std::vector<PointPair> pairs;
  for (int i = -3; i <= 3; ++i) {
    for (int j = -2; j <= 2; ++j) {
      const Eigen::Vector2d m(i * kMm, j * kMm);
      pairs.push_back(
          {m, camera.pixel_from_m(m) + noise_px * Eigen::Vector2d(normal(random), normal(random))});
    }
  }
  return pairs;
}

TEST(CameraCalibration, ScaleCenterAndRotationComeBack) {
  const CameraFit camera = a_camera(), fit = fit_camera(grid(camera));
  EXPECT_NEAR(fit.image.pixel / camera.image.pixel, 1, 1e-13);
  EXPECT_NEAR((fit.image.center_px - camera.image.center_px).norm(), 0, 1e-10);
  EXPECT_NEAR(fit.rotation, camera.rotation, 1e-13);
  EXPECT_LT(fit.max_residual_px, 1e-10);
  const Eigen::Vector2d m(1.3 * kMm, -0.4 * kMm);
  EXPECT_NEAR((fit.m_from_pixel(fit.pixel_from_m(m)) - m).norm(), 0, 1e-17);
}

TEST(CameraCalibration, TwoPointsAreEnoughAndLeaveNoResidual) {
  const CameraFit camera = a_camera();
  const auto all = grid(camera);
  const CameraFit fit = fit_camera(std::vector<PointPair>{all.front(), all.back()});
  EXPECT_NEAR(fit.rotation, camera.rotation, 1e-12);
  EXPECT_EQ(fit.scale_sigma, 0);
}

TEST(CameraCalibration, UncertaintiesAreThoseOfManyRuns) {
  const CameraFit camera = a_camera();
  constexpr int kRuns = 300;
  double scale = 0, rotation = 0, center = 0, scale_said = 0, rotation_said = 0, center_said = 0;
  for (int run = 0; run < kRuns; ++run) {
    const CameraFit fit = fit_camera(grid(camera, 0.3, 10 + run));
    scale += std::pow(fit.image.pixel - camera.image.pixel, 2) / kRuns;
    rotation += std::pow(fit.rotation - camera.rotation, 2) / kRuns;
    center += std::pow(fit.image.center_px.x() - camera.image.center_px.x(), 2) / kRuns;
    scale_said += std::pow(fit.scale_sigma, 2) / kRuns;
    rotation_said += std::pow(fit.rotation_sigma, 2) / kRuns;
    center_said += std::pow(fit.center_sigma_px.x(), 2) / kRuns;
  }
  // A variance of 300 runs is known to 8 %; three of that.
  EXPECT_NEAR(scale / scale_said, 1, 0.25);
  EXPECT_NEAR(rotation / rotation_said, 1, 0.25);
  EXPECT_NEAR(center / center_said, 1, 0.25);
}

TEST(CameraCalibration, PairsThatCannotSayAreRefused) {
  const auto good = grid(a_camera());
  const auto refused = [](const std::vector<PointPair>& pairs) {
    expect_refused("pairs", [&] { (void)fit_camera(pairs); });
  };
  refused({});
  refused({good[0]});
  refused({good[0], good[0], good[0]});
  auto bad = good;
  bad[2].pixel_px.x() = std::numeric_limits<double>::quiet_NaN();
  refused(bad);
  auto mirrored = good;
  for (PointPair& pair : mirrored) pair.m.x() = -pair.m.x();
  refused(mirrored);
  auto still = good;
  for (PointPair& pair : still) pair.pixel_px = {3, 3};
  refused(still);
}

TEST(PoseCalibration, OneLookOnTheKnownRetinaFindsTheImageScale) {
  const PoseSettings truth = default_settings();
  PoseSettings believed = truth;
  believed.image.pixel *= 0.97;
  const Eigen::Vector3d on_retina(0.5 * kMm, 0.3 * kMm, 2.0 * kMm),
      elsewhere(-1 * kMm, 1 * kMm, 5 * kMm);
  const auto seen = project_spheroid(truth, on_retina, kAlongX);
  ASSERT_TRUE(seen);
  const PoseCalibration found = calibrate_pose(believed, *seen, kAlongX, on_retina.z());
  EXPECT_NEAR(found.image_scale * 0.97, 1, 1e-6);  // the localizer stops at steps of nanometers
  EXPECT_LT(found.residual, 0.1 * kUm);
  const PoseSettings mended = found.applied(believed);
  const auto there = project_spheroid(truth, elsewhere, kAlongX);
  ASSERT_TRUE(there);
  const auto located =
      locate(mended, *there, tracker_noise(), kAlongX, *first_guess(mended, *there, kAlongX));
  ASSERT_TRUE(located);
  EXPECT_NEAR((located->position_in_eye - elsewhere).norm(), 0, 1 * kUm);
}

TEST(PoseCalibration, ARobotFlatOnTheRetinaIsFoundThoughASmallerScaleWouldPutItBelow) {
  // At 0.27 mm no scale a step smaller has an answer, for there is no place below the retina.
  const PoseSettings truth = default_settings();
  for (const double height : {0.05 * kMm, 0.27 * kMm, 0.5 * kMm}) {
    for (const double scale : {0.95, 0.985, 1.0, 1.013, 1.06}) {
      PoseSettings believed = truth;
      believed.image.pixel *= scale;
      const auto seen = project_spheroid(truth, {0.5 * kMm, 0.5 * kMm, height}, kAlongX);
      ASSERT_TRUE(seen);
      EXPECT_NEAR(calibrate_pose(believed, *seen, kAlongX, height).image_scale * scale, 1, 1e-5)
          << height;
    }
  }
  const auto seen = project_spheroid(truth, {0, 0, 0.27 * kMm}, kAlongX);
  PoseSettings believed = truth;
  believed.image.pixel *= 2;
  EXPECT_THROW(calibrate_pose(believed, *seen, kAlongX, 0.27 * kMm), std::invalid_argument);
}

TEST(PoseCalibration, TheAdditiveOffsetMendsTheKnownPointItself) {
  const PoseSettings truth = default_settings();
  PoseSettings believed = truth;
  believed.image.pixel *= 0.99;
  const Eigen::Vector3d on_retina(0, 0, 2.5 * kMm);
  const auto seen = project_spheroid(truth, on_retina, kOblique);
  ASSERT_TRUE(seen);
  const PoseCalibration found =
      calibrate_pose(believed, *seen, kOblique, on_retina.z(), PoseCorrection::additive_offset);
  EXPECT_EQ(found.image_scale, 1);
  const auto located =
      locate(believed, *seen, tracker_noise(), kOblique, *first_guess(believed, *seen, kOblique));
  ASSERT_TRUE(located);
  EXPECT_GT(std::abs(located->position_in_eye.z() - on_retina.z()), 50 * kUm);
  EXPECT_NEAR(found.applied(located->position_in_eye).z(), on_retina.z(), 0.1 * kUm);
}

TEST(PoseCalibration, WhatNoScaleExplainsIsRefused) {
  const PoseSettings settings = default_settings();
  auto seen = project_spheroid(settings, {0, 0, 3 * kMm}, kAlongX);
  ASSERT_TRUE(seen);
  expect_refused("known_z", [&] { (void)calibrate_pose(settings, *seen, kAlongX, std::nan("")); });
  expect_refused("observed", [&] { (void)calibrate_pose(settings, *seen, kAlongX, 60 * kMm); });
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
