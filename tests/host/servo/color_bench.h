// A simulated rig with a color camera for tests of the eyes of the servo loop: a photographed
// ground that may drift and have vessels of the robot's gray, and a model of the robot learnt
// before it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/servo/believed_view.h"
#include "tests/host/rig/fake_rig.h"
#include "vision/multi_tracker.h"

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include <string>
#include <utility>
#include <vector>

namespace vitreo {

/// A photograph (tests/images), with vessels as dark and gray as the robot where asked.
inline std::string photographed_ground(const TemporaryFolder& folder, bool gray_vessels) {
  cv::Mat ground = cv::imread(VITREO_SOURCE_DIR "/tests/images/fundus.jpg", cv::IMREAD_COLOR);
  cv::RNG random(5);
  for (int k = 0; gray_vessels && k < 14; ++k) {
    cv::Point2d at(random.uniform(0.0, 1.0) * ground.cols, random.uniform(0.0, 1.0) * ground.rows);
    double heading = random.uniform(0.0, 6.28);
    for (int step = 0; step < 60; ++step) {
      heading += random.gaussian(0.1);
      const cv::Point2d to = at + 8.0 * cv::Point2d(std::cos(heading), std::sin(heading));
      cv::line(ground, at, to, {72, 71, 70}, 3 + k % 4, cv::LINE_AA);
      at = to;
    }
  }
  const std::string file = (folder.path() / "ground.png").string();
  cv::imwrite(file, ground);
  return file;
}

struct Scenery {
  bool gray_vessels = false;
  double drift = 0;  // m/s
  bool color = true;
};

/// The bench of thesis 5.5, a machine as believed.
inline RigDescription color_rig(const TemporaryFolder& folder, const Scenery& scenery) {
  RigDescription rig = whole_rig();
  ConfigTable camera{{"width_px", {656.0}},
                     {"height_px", {490.0}},
                     {"effective_pixel", {20.7e-6}},
                     {"projection", {"exact"}},
                     {"projection_reach", {8e-3}}};
  if (scenery.color) camera["sensor"] = ConfigValue{ConfigTable{{"color", {"bayer"}}}};
  rig.table["top_camera"] = ConfigValue{camera};
  rig.table.erase("side_camera");
  rig.table["truth"] =
      ConfigValue{ConfigTable{{"machine", {"nominal"}},
                              {"drawn_as", {"ellipsoid"}},
                              {"fundus", {photographed_ground(folder, scenery.gray_vessels)}},
                              {"fundus_width", {26e-3}},
                              {"fundus_drift", {scenery.drift}}}};
  return rig;
}

/// One picture of the robot where the pose sensor holds it, with its outline by the truth in place
/// of a hand.
inline vision::LabeledImage labeled_at(TestBench& bench, const Eigen::Vector3d& place,
                                       const Eigen::Vector3d& axis) {
  ServoSettings settings;
  settings.feedback = Feedback::pose_sensor;
  settings.law = ControlLaw::estimator;
  settings.axis = axis.normalized();
  Rig& rig = bench.roles();
  rig.sample->remove_robot();
  Servo servo(*bench.clock, rig, *bench.recorder, {}, settings);
  servo.hold(place);
  rig.sample->insert_robot(place);
  bench.clock->sleep_for(from_seconds(1));
  const Frame frame = rig.top_camera->grab(from_seconds(1));
  const auto truth = bench.rig->laboratory()->truth(frame.exposed);
  const auto seen = BelievedView(rig.model, rig.top_camera->info(), truth->axis)
                        .ellipse_at(truth->position)
                        ->ellipse;
  cv::Mat mask = cv::Mat::zeros(frame.image.size(), CV_8UC1);
  const cv::Point2f center(static_cast<float>(seen.center_px.x()),
                           static_cast<float>(seen.center_px.y()));
  const cv::Size2f size(static_cast<float>(2 * seen.semi_major_px),
                        static_cast<float>(2 * seen.semi_minor_px));
  cv::ellipse(mask, cv::RotatedRect(center, size, static_cast<float>(seen.angle * 180 / M_PI)), 255,
              cv::FILLED);
  cv::Mat image = frame.image;
  if (image.channels() == 1) cv::cvtColor(frame.image, image, cv::COLOR_GRAY2BGR);
  return {image, mask};
}

/// Learnt at ten places of the workspace.
inline std::vector<vision::TrackedObject> learnt_colors(TestBench& bench) {
  std::vector<vision::LabeledImage> images;
  for (int k = 0; k < 10; ++k) {
    const double turn = 2.4 * k;
    images.push_back(
        labeled_at(bench, {2.2e-3 * std::cos(turn), 1.6e-3 * std::sin(turn), (k % 5 - 2) * 0.8e-3},
                   {std::cos(0.7 * k), std::sin(0.7 * k), 0.25 * std::sin(1.0 * k)}));
  }
  bench.roles().sample->remove_robot();
  bench.clock->sleep_for(from_seconds(0.3));
  return {{vision::ObjectModel::train(images, {}, {}), {}}};
}

}  // namespace vitreo
