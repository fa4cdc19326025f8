// A tracker and what continues its object's rim for one image: a vessel, or a shadow in weak light.
// SPDX-License-Identifier: Apache-2.0
#include "tests/vision/tracking_score.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

using generated::Frame;
using generated::Sequence;

// A patch of the robot's gray, as wide as it is, behind one end: both together look like a longer
// ellipse.
void lengthen(cv::Mat& image, const Ellipse& robot, double by_px) {
  const double shift = by_px * 0.9;
  const cv::Point2d at(robot.center_px.x() + shift * std::cos(robot.angle),
                       robot.center_px.y() + shift * std::sin(robot.angle));
  cv::Mat patch = cv::Mat::zeros(image.size(), CV_32FC1);
  cv::ellipse(patch,
              cv::RotatedRect(cv::Point2f(at),
                              cv::Size2f(static_cast<float>(2 * robot.semi_major_px),
                                         static_cast<float>(2 * robot.semi_minor_px)),
                              static_cast<float>(robot.angle * 180 / CV_PI)),
              1.0, cv::FILLED, cv::LINE_AA);
  cv::Mat own = Sequence::mask_of(robot, image.size());
  patch.setTo(0, own);
  cv::GaussianBlur(patch, patch, {0, 0}, 1.3);
  for (int v = 0; v < image.rows; ++v)
    for (int u = 0; u < image.cols; ++u) {
      const float share = patch.at<float>(v, u);
      auto& at_pixel = image.at<cv::Vec3b>(v, u);
      for (int c = 0; c < 3 && share > 0; ++c)
        at_pixel[c] = cv::saturate_cast<unsigned char>(
            (1 - share) * static_cast<float>(at_pixel[c]) + share * 62);
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
    if (continued) lengthen(frame.image, frame.truth, 8);
    const Track track = tracker.update(frame.image);
    if (!track.measured) continue;
    const double off = (track.measured->ellipse.center_px - frame.truth.center_px).norm();
    (continued ? worst : clear) = std::max(continued ? worst : clear, off);
    seen += continued;
  }
  std::printf("worst: %.2f px without, %.2f px with a patch behind one end\n", clear, worst);
  EXPECT_GE(seen, 8);
  EXPECT_LT(worst, 1.5);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
