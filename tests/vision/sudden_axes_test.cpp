// A tracker and what continues its object's rim for one image: a vessel, or a shadow in weak light.
// SPDX-License-Identifier: Apache-2.0
#include "tests/vision/tracking_score.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace vitreo::vision {
namespace {

using generated::Frame;
using generated::Sequence;

// A tongue of the robot's gray from one end on.
void lengthen(cv::Mat& image, const Ellipse& robot, double by_px) {
  const cv::Point2d along(std::cos(robot.angle), std::sin(robot.angle));
  const cv::Point2d across(-along.y, along.x);
  const cv::Point2d center(robot.center_px.x(), robot.center_px.y());
  std::vector<cv::Point> corners;
  const double from = robot.semi_major_px - 8;
  const double to = robot.semi_major_px + by_px;
  for (const auto& [x, y] : {std::pair(from, -9.0), {from, 9.0}, {to, 7.0}, {to, -7.0}}) {
    const cv::Point2d p = center + x * along + y * across;
    corners.emplace_back(cvRound(16 * p.x), cvRound(16 * p.y));
  }
  cv::Mat tongue = cv::Mat::zeros(image.size(), CV_32FC1);
  cv::fillConvexPoly(tongue, corners, 1.0, cv::LINE_AA, 4);
  cv::GaussianBlur(tongue, tongue, {0, 0}, 1.3);
  for (int v = 0; v < image.rows; ++v)
    for (int u = 0; u < image.cols; ++u) {
      const float share = tongue.at<float>(v, u);
      auto& at = image.at<cv::Vec3b>(v, u);
      for (int c = 0; c < 3 && share > 0; ++c)
        at[c] =
            cv::saturate_cast<unsigned char>((1 - share) * static_cast<float>(at[c]) + share * 70);
    }
}

TEST(SuddenAxes, what_continues_one_end_of_the_rim_in_single_images_does_not_move_the_center) {
  Sequence sequence({.seed = 8101});
  ColorTracker tracker(generated::trained_on(sequence), {});
  double clear = 0;
  double worst = 0;
  int seen = 0;
  for (int k = 0; k < 80; ++k) {
    Frame frame = sequence.frame(k);
    const bool continued = k > 20 && k % 6 == 0;
    if (continued) lengthen(frame.image, frame.truth, 9);
    const Track track = tracker.update(frame.image);
    if (!track.measured) continue;
    const double off = (track.measured->ellipse.center_px - frame.truth.center_px).norm();
    (continued ? worst : clear) = std::max(continued ? worst : clear, off);
    seen += continued;
  }
  std::printf("worst: %.2f px without, %.2f px with a tongue of 9 px\n", clear, worst);
  EXPECT_GE(seen, 8);
  EXPECT_LT(worst, 1.5);
}

}  // namespace
}  // namespace vitreo::vision
