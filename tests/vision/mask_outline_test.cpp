// Masks from outlines: exact, cut by color, and refused.
// SPDX-License-Identifier: Apache-2.0
#include "vision/mask_outline.h"

#include "tests/vision/sequence_generator.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

double common(const cv::Mat& a, const cv::Mat& b) {
  return static_cast<double>(cv::countNonZero(a & b)) / cv::countNonZero(a | b);
}

TEST(MaskOutline, holds_the_pixels_whose_center_is_inside) {
  const Ellipse e{{40, 30}, 20, 11, 0.5};
  MaskOutline outline;
  outline.ellipses = {e};
  EXPECT_EQ(cv::norm(mask_of(outline, {80, 60}), generated::Sequence::mask_of(e, {80, 60})), 0);
  MaskOutline square;
  square.polygons_px = {{{9.5, 4.5}, {19.5, 4.5}, {19.5, 14.5}, {9.5, 14.5}}};
  EXPECT_EQ(cv::countNonZero(mask_of(square, {80, 60})), 100);
}

TEST(MaskOutline, cut_by_color_mends_a_rough_ellipse) {
  generated::Sequence sequence({.seed = 77, .fundus = true});
  const generated::Frame frame = sequence.frame(3);
  Ellipse rough = frame.truth;
  rough.center_px += Eigen::Vector2d(3, -2);
  rough.semi_major_px *= 1.1;
  rough.angle += 0.1;
  MaskOutline outline;
  outline.ellipses = {rough};
  const cv::Mat truth = generated::Sequence::mask_of(frame.truth, frame.image.size());
  const cv::Mat before = mask_of(outline, frame.image.size());
  const cv::Mat cut = cut_by_color(frame.image, before, outline, 8);
  EXPECT_LT(common(before, truth), 0.82);
  EXPECT_GT(common(cut, truth), 0.90);  // half a pixel all round a 60 x 30 px ellipse is 7 %
  EXPECT_EQ(cv::norm(cut, cut_by_color(frame.image, before, outline, 8)), 0) << "the same twice";
}

TEST(MaskOutline, refuses_what_is_no_outline) {
  EXPECT_THROW(mask_of({}, {80, 60}), std::invalid_argument);
  MaskOutline outside;
  outside.ellipses = {{{500, 500}, 9, 5, 0}};
  EXPECT_THROW(mask_of(outside, {80, 60}), std::invalid_argument);
  MaskOutline line;
  line.polygons_px = {{{1, 1}, {9, 9}}};
  EXPECT_THROW(mask_of(line, {80, 60}), std::invalid_argument);
  MaskOutline flat;
  flat.ellipses = {{{40, 30}, 9, 0, 0}};
  EXPECT_THROW(mask_of(flat, {80, 60}), std::invalid_argument);
  const cv::Mat image = cv::Mat::zeros(60, 80, CV_8UC3), mask(60, 80, CV_8UC1, cv::Scalar(0));
  EXPECT_THROW(cut_by_color(image, mask, {}, 6), std::invalid_argument);
  EXPECT_THROW(cut_by_color(mask, mask, {}, 6), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
