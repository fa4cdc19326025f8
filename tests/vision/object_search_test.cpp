// Search of an object in a whole image: the order of its candidates.
// SPDX-License-Identifier: Apache-2.0
#include "vision/object_search.h"

#include "vision/color_model.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <vector>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

const cv::Scalar kGround(48, 84, 156);
const cv::Scalar kSteel(66, 64, 62);

cv::Mat scene(const Ellipse& object) {
  cv::Mat image(480, 640, CV_8UC3, kGround);
  cv::ellipse(image,
              cv::RotatedRect(cv::Point2f(static_cast<float>(object.center_px.x()),
                                          static_cast<float>(object.center_px.y())),
                              cv::Size2f(static_cast<float>(2 * object.semi_major_px),
                                         static_cast<float>(2 * object.semi_minor_px)),
                              static_cast<float>(object.angle * 180 / CV_PI)),
              kSteel, cv::FILLED);
  return image;
}

ColorModel trained_on(const Ellipse& object) {
  const cv::Mat image = scene(object);
  cv::Mat mask;
  cv::inRange(image, kSteel, kSteel, mask);
  return ColorModel::train(std::vector<LabeledImage>{{image, mask}}, {});
}

// A lamp that moves leaves a wide part of the ground in the object's colors: each box in it is as
// full as the object's own.
TEST(ObjectSearch, a_body_before_ground_comes_before_a_wide_part_of_the_ground_in_its_colors) {
  const Ellipse object{{540, 90}, 30, 15, 0.4};
  const ColorModel model = trained_on(object);
  ColorEvidence colors(model);
  cv::Mat image = scene(object);
  image(cv::Rect(0, 160, 640, 320)).setTo(kSteel);
  ObjectSearch search(object);
  const std::vector<Ellipse>& found = search.find(image, colors, {320, 240}, 3);
  ASSERT_FALSE(found.empty());
  EXPECT_LT((found[0].center_px - object.center_px).norm(), 4);
}

TEST(ObjectSearch, a_body_at_the_images_border_is_still_a_candidate) {
  const Ellipse object{{628, 240}, 30, 15, 0};
  const ColorModel model = trained_on(object);
  ColorEvidence colors(model);
  ObjectSearch search(object);
  const std::vector<Ellipse>& found = search.find(scene(object), colors, {320, 240}, 3);
  ASSERT_FALSE(found.empty());
  EXPECT_LT((found[0].center_px - object.center_px).norm(), 14);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
