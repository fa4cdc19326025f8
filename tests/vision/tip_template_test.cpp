// Tip template: a needle's point that was pointed at once, found in other images by its ellipse.
// SPDX-License-Identifier: Apache-2.0
#include "vision/tip_template.h"

#include "tests/vision/needle_scene.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <numbers>
#include <stdexcept>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

// The ellipse as a tracker has it: known modulo a half turn, off by half a pixel and 1.5 degrees.
Ellipse rough(Ellipse e, int k) {
  e.center_px += Eigen::Vector2d(k % 2 == 0 ? 0.5 : -0.5, k % 3 == 0 ? 0.4 : -0.4);
  e.angle = std::remainder(e.angle + (k % 2 == 0 ? 0.026 : -0.026), std::numbers::pi);
  return e;
}

TEST(TipTemplate, finds_a_needles_point_in_other_images_and_never_at_the_other_end) {
  int found = 0, asked = 0;
  double off = 0;
  for (const std::uint64_t seed : {61U, 62U, 63U}) {
    needle::Scene scene({.seed = seed});
    const needle::Frame first = scene.frame(0);
    const TipTemplate tip(first.image, first.truth, first.tip_px);
    for (int k = 1; k < 16; ++k, ++asked) {
      const needle::Frame frame = scene.frame(17 * k);
      const auto at = tip.find(frame.image, rough(frame.truth, k));
      if (!at) continue;
      ++found;
      off += (*at - frame.tip_px).norm();
      EXPECT_LT((*at - frame.tip_px).norm(), 4) << seed << ", " << k;
    }
  }
  std::printf("tips: %d of %d, %.2f px\n", found, asked, off / found);
  EXPECT_GE(found, 0.8 * asked);
  EXPECT_LT(off / found, 1.2);
}

TEST(TipTemplate, says_nothing_of_a_body_whose_ends_are_alike) {
  cv::Mat image(120, 160, CV_8UC3, cv::Scalar(60, 90, 160));
  cv::ellipse(image, {80, 60}, {30, 15}, 0, 0, 360, cv::Scalar(70, 70, 70), cv::FILLED);
  const Ellipse body{{80, 60}, 30, 15, 0};
  EXPECT_FALSE(TipTemplate(image, body, {110, 60}).find(image, body));
}

TEST(TipTemplate, refuses_a_tip_that_is_no_end) {
  const cv::Mat image(120, 160, CV_8UC3, cv::Scalar(60, 90, 160));
  const Ellipse body{{80, 60}, 30, 15, 0};
  EXPECT_THROW(TipTemplate(image, body, {82, 75}), std::invalid_argument);
  EXPECT_THROW(TipTemplate(image, body, {160, 60}), std::invalid_argument);
  EXPECT_THROW(TipTemplate(image, {{15, 60}, 30, 15, 0}, {150, 60}), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
