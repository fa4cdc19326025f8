// View watch: a camera that was moved, or whose light changed, is told from one that sees a robot.
// SPDX-License-Identifier: Apache-2.0
#include "host/servo/view_watch.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

namespace vitreo {
namespace {

/// Vessels on a bright ground, with noise of its own each time.
cv::Mat scene(std::uint64_t number, const cv::Point2d& shift = {0, 0}) {
  cv::Mat picture(240, 320, CV_8UC1, cv::Scalar(150));
  for (int k = 0; k < 7; ++k)
    cv::line(picture, cv::Point(20 + 45 * k, 0), cv::Point(5 + 40 * k, 239), cv::Scalar(90), 6);
  cv::line(picture, cv::Point(0, 60), cv::Point(319, 130), cv::Scalar(100), 6);
  cv::GaussianBlur(picture, picture, {0, 0}, 3);
  cv::Mat moved;
  const cv::Mat motion = (cv::Mat_<double>(2, 3) << 1, 0, shift.x, 0, 1, shift.y);
  cv::warpAffine(picture, moved, motion, picture.size(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  cv::Mat noise(picture.size(), CV_16SC1);
  cv::RNG random(number);
  random.fill(noise, cv::RNG::NORMAL, 0, 2);
  cv::add(moved, noise, moved, cv::noArray(), CV_8UC1);
  return moved;
}

struct ViewWatchTest : testing::Test {
  ViewWatch watch = [] {
    vision::Background background;
    for (std::uint64_t k = 0; k < 10; ++k) background.learn(scene(k + 1));
    return ViewWatch(background);
  }();
};

TEST_F(ViewWatchTest, SeesTheSceneWithARobotAndASpeckInIt) {
  for (std::uint64_t k = 100; k < 130; ++k) {
    cv::Mat picture = scene(k);
    cv::ellipse(picture, cv::Point(40 + static_cast<int>(k), 100), {30, 14}, 20, 0, 360,
                cv::Scalar(20), cv::FILLED);
    cv::circle(picture, {200, 180}, 25, cv::Scalar(30), cv::FILLED);
    EXPECT_EQ(watch.fault(picture), "");
  }
}

TEST_F(ViewWatchTest, FindsTheShiftOfACameraThatWasKnocked) {
  const ViewChange change = watch.look(scene(7, {1.2, -0.8}));
  EXPECT_NEAR(change.shift_px.x, 1.2, 0.3);
  EXPECT_NEAR(change.shift_px.y, -0.8, 0.3);
  EXPECT_NE(watch.fault(scene(8, {3, 0})), "");
  EXPECT_NE(watch.fault(scene(9, {0, -20})), "");
}

TEST_F(ViewWatchTest, TellsAPictureThatIsMirroredTurnedOrOfOtherLight) {
  cv::Mat mirrored, turned, bright;
  cv::flip(scene(11), mirrored, 1);
  cv::rotate(scene(12), turned, cv::ROTATE_180);
  scene(13).convertTo(bright, -1, 1.4);
  for (const cv::Mat& picture : {mirrored, turned, bright}) EXPECT_NE(watch.fault(picture), "");
}

TEST_F(ViewWatchTest, OfASceneWithoutStructureSaysNoShift) {
  vision::Background plain;
  for (int k = 0; k < 5; ++k) plain.learn(cv::Mat(100, 100, CV_8UC1, cv::Scalar(120 + k % 2)));
  EXPECT_EQ(ViewWatch(plain).fault(cv::Mat(100, 100, CV_8UC1, cv::Scalar(121))), "");
}

}  // namespace
}  // namespace vitreo
