// Where a robot may be taken, and from where: inside the believed eye, but for one that is found
// behind the believed retina, which may be brought in.
// SPDX-License-Identifier: Apache-2.0
#include "host/servo/servo_settings.h"
#include "host/servo/visibility.h"
#include "optics/projection/single_viewpoint.h"
#include "optics/system/prescriptions.h"

#include <gtest/gtest.h>

#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

constexpr double kMm = 1e-3;
const control::MotionLimits kSlow{1e-3, 10e-3};

RigModel eye_model() {
  RigModel model;
  model.eye = optics::model_eye_5_3();
  model.eye_in_world = {0, 0, -5 * kMm};
  model.projection = optics::fit_single_viewpoint(model.eye, optics::Microscope{}, 7 * kMm);
  return model;
}

std::string refusal(const std::vector<Eigen::Vector3d>& points,
                    const std::optional<Eigen::Vector3d>& robot) {
  try {
    check_reach(eye_model(), control::Trajectory::waypoints(points, kSlow), robot);
  } catch (const std::invalid_argument& e) {
    return e.what();
  }
  return "";
}

TEST(Reach, ARobotThatIsFoundBehindTheRetinaMayBeBroughtIn) {
  const Eigen::Vector3d robot(0.5 * kMm, 0, -5.4 * kMm), inside(0, 0, -2 * kMm);
  EXPECT_EQ(refusal({robot, inside}, robot), "");
  EXPECT_NE(refusal({robot, inside}, std::nullopt).find("outside the retina"), std::string::npos);
  const Eigen::Vector3d elsewhere = robot + Eigen::Vector3d(1 * kMm, 0, 0);
  EXPECT_NE(refusal({robot, inside}, elsewhere).find("outside the retina"), std::string::npos);
}

TEST(Reach, ItMayNotGoFartherOutNorBeLeftThereNorGoOutAgain) {
  const Eigen::Vector3d robot(0.5 * kMm, 0, -5.4 * kMm), inside(0, 0, -2 * kMm);
  const Eigen::Vector3d deeper = robot - Eigen::Vector3d(0, 0, 0.3 * kMm);
  for (const std::vector<Eigen::Vector3d>& path :
       {std::vector<Eigen::Vector3d>{robot, deeper, inside},
        {robot, inside, robot},
        {inside, robot},
        {robot, robot + Eigen::Vector3d(0, 0, 0.1 * kMm)}})
    EXPECT_NE(refusal(path, robot).find("outside the retina"), std::string::npos);
  EXPECT_THROW(check_reach(eye_model(), control::Trajectory::hold_at(robot), robot),
               std::invalid_argument);
}

CameraInfo camera_of(int width_px, int height_px) {
  CameraInfo camera;
  camera.width_px = width_px;
  camera.height_px = height_px;
  return camera;
}

/// Its middle on the camera's.
RigModel seen_by(const CameraInfo& camera) {
  RigModel model = eye_model();
  model.top_image.center_px = {camera.width_px / 2.0, camera.height_px / 2.0};
  return model;
}

TEST(Reach, AWayOutFromBehindTheRetinaIsInTheCamerasSight) {
  const CameraInfo camera = camera_of(640, 480);
  const RigModel model = seen_by(camera);
  const Eigen::Vector3d inside(0, 0, -2 * kMm);
  const auto from = [&](double z) {
    return control::Trajectory::line({0.5 * kMm, 0, z}, inside, kSlow);
  };
  EXPECT_NO_THROW(check_visible(model, camera, {}, from(-5.6 * kMm)));
  EXPECT_THROW(check_visible(model, camera, {}, from(-8 * kMm)), std::invalid_argument);
}

// What is added to a place found is taken off before it is asked where it shows; and of a robot
// that is shown to its middle alone the outline is none.
TEST(Reach, WhatIsShownIsThePlaceWithoutTheCorrectionAndTheWholeRobot) {
  const CameraInfo camera = camera_of(4000, 4000);
  const RigModel model = seen_by(camera);
  const auto shown = [&](double x, const SightedAs& sighted) {
    try {
      check_visible(model, camera, sighted, control::Trajectory::hold_at({x, 0, 2 * kMm}));
    } catch (const std::invalid_argument&) {
      return false;
    }
    return true;
  };
  const auto farthest = [&](const SightedAs& sighted) {
    double x = 0;
    while (x < 10 * kMm && shown(x, sighted)) x += 0.01 * kMm;
    return x;
  };
  const double along = farthest({}), upright = farthest({1, {0, 0, 0}, {0, 0, 1}});
  ASSERT_LT(along, 9 * kMm);
  EXPECT_NEAR(farthest({1, {0.8 * kMm, 0, 0}, {1, 0, 0}}), along + 0.8 * kMm, 0.02 * kMm);
  EXPECT_NEAR(farthest({1, {-0.8 * kMm, 0, 0}, {1, 0, 0}}), along - 0.8 * kMm, 0.02 * kMm);
  EXPECT_GT(upright, along + 0.5 * kMm) << "its end is 1 mm before its middle";
  // One that has drifted there may be led back, and none is led there.
  const Eigen::Vector3d middle(0, 0, 2 * kMm), aside(along + 0.3 * kMm, 0, 2 * kMm);
  EXPECT_NO_THROW(
      check_visible(model, camera, {}, control::Trajectory::line(aside, middle, kSlow)));
  for (const auto& path : {control::Trajectory::line(middle, aside, kSlow),
                           control::Trajectory::waypoints({middle, aside, middle}, kSlow)})
    EXPECT_THROW(check_visible(model, camera, {}, path), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
