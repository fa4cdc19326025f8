// SPDX-License-Identifier: Apache-2.0
#include "vision/draw.h"

#include <gtest/gtest.h>

#include <limits>
#include <stdexcept>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

TEST(DrawOverlay, leaves_the_picture_alone_when_there_is_nothing_to_draw) {
  const cv::Mat gray(50, 80, CV_8U, cv::Scalar(99));
  const cv::Mat picture = draw_overlay(gray, {});
  ASSERT_EQ(picture.type(), CV_8UC3);
  EXPECT_EQ(picture.size(), gray.size());
  EXPECT_EQ(picture.at<cv::Vec3b>(20, 30), cv::Vec3b(99, 99, 99));
}

TEST(DrawOverlay, draws_the_tracked_contour_where_it_is_and_thin) {
  const cv::Mat gray(200, 300, CV_8U, cv::Scalar(120));
  Overlay overlay;
  overlay.tracked = Ellipse{{150, 100}, 60, 30, 0};
  const cv::Mat picture = draw_overlay(gray, overlay);
  const cv::Vec3b rim = picture.at<cv::Vec3b>(70, 150);
  EXPECT_GT(rim[1] - std::max(rim[0], rim[2]), 80);  // green against gray
  EXPECT_EQ(picture.at<cv::Vec3b>(66, 150), cv::Vec3b(120, 120, 120));
  EXPECT_EQ(picture.at<cv::Vec3b>(74, 150), cv::Vec3b(120, 120, 120));
}

TEST(DrawOverlay, takes_what_lies_outside_or_is_no_number) {
  const cv::Mat gray(100, 100, CV_8U, cv::Scalar(120));
  Overlay overlay;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  overlay.tracked = Ellipse{{1e9, -500}, 60, 30, 0};
  overlay.expected = Ellipse{{nan, 0}, 60, 30, 0};
  overlay.trail_px = {{0, 0}, {nan, nan}, {1e300, 0}, {50, 50}};
  overlay.target_px = Eigen::Vector2d(-20, 50);
  overlay.scale_bar_px = 1000;
  EXPECT_NO_THROW(draw_overlay(gray, overlay));
  EXPECT_THROW(draw_overlay(cv::Mat(), overlay), std::invalid_argument);
  EXPECT_THROW(draw_overlay(cv::Mat(4, 4, CV_16UC3), overlay), std::invalid_argument);
}

TEST(DrawOverlay, draws_on_color_without_touching_the_original) {
  const cv::Mat image(100, 100, CV_8UC3, cv::Scalar(10, 20, 200));
  Overlay overlay;
  overlay.tracked = Ellipse{{50, 50}, 30, 15, 0};
  overlay.covariance_px2 = Eigen::Matrix2d(0.04 * Eigen::Matrix2d::Identity());
  overlay.contours_px = {{{10, 10}, {20, 10}, {20, 20}}};
  overlay.caption = "7 tracking";
  const cv::Mat picture = draw_overlay(image, overlay);
  EXPECT_EQ(picture.at<cv::Vec3b>(90, 5), cv::Vec3b(10, 20, 200));
  EXPECT_EQ(image.at<cv::Vec3b>(50, 80), cv::Vec3b(10, 20, 200));
  EXPECT_NE(picture.at<cv::Vec3b>(50, 80), cv::Vec3b(10, 20, 200)) << "the rim";
  EXPECT_NE(picture.at<cv::Vec3b>(10, 15), cv::Vec3b(10, 20, 200)) << "the contour";
  // 0.2 px, times 2.45 for 95 %, times ten: about 5 px from the center.
  int circle = 0;
  for (int u = 52; u < 58; ++u) circle += picture.at<cv::Vec3b>(47, u)[2] != 200;
  EXPECT_GT(circle, 0);
}

TEST(CropAround, keeps_its_size_and_moves_inside) {
  cv::Mat image(100, 200, CV_8U);
  for (int v = 0; v < 100; ++v) {
    for (int u = 0; u < 200; ++u) image.at<unsigned char>(v, u) = static_cast<unsigned char>(u);
  }
  const cv::Mat middle = crop_around(image, {100, 50}, {21, 11});
  EXPECT_EQ(middle.size(), cv::Size(21, 11));
  EXPECT_EQ(middle.at<unsigned char>(5, 10), 100);
  EXPECT_EQ(crop_around(image, {-40, 50}, {21, 11}).at<unsigned char>(0, 0), 0);
  EXPECT_EQ(crop_around(image, {400, 400}, {21, 11}).at<unsigned char>(10, 20), 199);
  EXPECT_EQ(crop_around(image, {10, 10}, {500, 500}).size(), image.size());
  EXPECT_THROW(crop_around(image, {10, 10}, {0, 5}), std::invalid_argument);
  EXPECT_THROW(crop_around(image, {std::numeric_limits<double>::quiet_NaN(), 1}, {5, 5}),
               std::invalid_argument);
  EXPECT_THROW(crop_around(cv::Mat(), {1, 1}, {5, 5}), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
