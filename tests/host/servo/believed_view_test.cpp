// The believed view against the tracker's ellipse in drawn images, and against the shadow of an
// ellipsoid.
// SPDX-License-Identifier: Apache-2.0
#include "host/servo/believed_view.h"

#include "host/servo/localizer.h"
#include "tests/host/rig/fake_rig.h"

#include <gtest/gtest.h>

#include <cmath>

namespace vitreo {
namespace VITREO_TEST_FILE {

TEST(BelievedView, IsTheEllipseThatATrackerFindsInTheImage) {
  TestBench bench(1, {}, rig_of_known_size());
  ServoCameras eyes = bench.eyes();
  ServoSettings settings;
  settings.feedback = Feedback::pose_sensor;
  settings.law = ControlLaw::estimator;
  Servo servo(*bench.clock, bench.roles(), *bench.recorder, {}, settings);
  servo.hold({1e-3, 0.5e-3, 0});
  bench.roles().sample->insert_robot({1e-3, 0.5e-3, 0});
  bench.clock->sleep_for(from_seconds(5));
  const Frame frame = bench.roles().top_camera->grab(from_seconds(1));
  const auto truth = bench.rig->laboratory()->truth(frame.exposed);
  const auto seen = Localizer(bench.roles().model, *eyes.top, {1, 0, 0}).look(frame.image).ellipse;
  ASSERT_TRUE(truth && seen);
  const BelievedView view(bench.roles().model, bench.roles().top_camera->info(), truth->axis);
  const auto believed = view.ellipse_at(truth->position);
  ASSERT_TRUE(believed);
  // px: crossed plates are no ellipsoid and a robot is blurred, which the tracker has in full
  EXPECT_LT((believed->ellipse.center_px - seen->ellipse.center_px).norm(), 0.5);
  EXPECT_NEAR(believed->ellipse.semi_major_px, seen->ellipse.semi_major_px, 1);
  EXPECT_NEAR(believed->ellipse.semi_minor_px, seen->ellipse.semi_minor_px, 1);
  EXPECT_NEAR(believed->ellipse.angle, seen->ellipse.angle, 0.03);
  EXPECT_FALSE(view.ellipse_at({0, 0, 50e-3})) << "no such place in the eye";
}

TEST(BelievedView, OfAPlainViewIsTheShadowOfTheEllipsoid) {
  RigModel model;
  model.plain_view = true;
  model.top_image = {20e-6, {320, 240}};
  model.robot.semi_axis = 1e-3;
  model.robot.semi_radius = 0.5e-3;
  CameraInfo camera;
  camera.width_px = 640;
  camera.height_px = 480;
  const double s = std::sqrt(0.5);
  const auto flat = BelievedView(model, camera, {s, s, 0}).ellipse_at({2e-3, 1e-3, 7e-3});
  ASSERT_TRUE(flat);
  EXPECT_NEAR(flat->ellipse.center_px.x(), 420, 1e-9) << "2 mm to the right";
  EXPECT_NEAR(flat->ellipse.center_px.y(), 190, 1e-9) << "1 mm up";
  EXPECT_NEAR(flat->ellipse.semi_major_px, 50, 1e-9);
  EXPECT_NEAR(flat->ellipse.semi_minor_px, 25, 1e-9);
  EXPECT_NEAR(flat->ellipse.angle, -M_PI / 4, 1e-9) << "v points down";
  const auto tilted = BelievedView(model, camera, {s, 0, s}).ellipse_at({0, 0, 0});
  ASSERT_TRUE(tilted);
  // the half width of an ellipsoid along a direction u is sqrt(sum of (semi-axis * u)^2)
  EXPECT_NEAR(tilted->ellipse.semi_major_px, std::hypot(50 * s, 25 * s), 1e-9);
  const auto upright = BelievedView(model, camera, {0, 0, 1}).ellipse_at({0, 0, 0});
  ASSERT_TRUE(upright);
  EXPECT_NEAR(upright->ellipse.semi_major_px, 25, 1e-9);
  EXPECT_FALSE(BelievedView(model, camera, {1, 0, 0}).ellipse_at({-7e-3, 0, 0}))
      << "beyond the left edge of the image";
  EXPECT_THROW(BelievedView(model, camera, {1, 1, 0}), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
