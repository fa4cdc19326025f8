// The plain background trackers: what they find over a still scene, and where each stops.
// SPDX-License-Identifier: Apache-2.0
#include "vision/background_tracker.h"

#include "tests/vision/sequence_generator.h"

#include <gtest/gtest.h>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

constexpr BackgroundKind kKinds[] = {BackgroundKind::fixed, BackgroundKind::running,
                                     BackgroundKind::mog2, BackgroundKind::knn};

/// A noisy scene, with a dark ellipse or without.
cv::Mat scene(int k, const Ellipse* at = nullptr) {
  cv::Mat image(120, 160, CV_8UC3, cv::Scalar(60, 100, 170));
  if (at) image.setTo(cv::Scalar(70, 70, 70), generated::Sequence::mask_of(*at, image.size()));
  cv::Mat noise(image.size(), CV_8UC3);
  cv::RNG random(static_cast<std::uint64_t>(k) + 1);
  random.fill(noise, cv::RNG::UNIFORM, 0, 7);
  return image + noise;
}

TEST(BackgroundTracker, finds_what_is_new_whatever_the_kind) {
  for (const BackgroundKind kind : kKinds) {
    BackgroundTracker tracker({.kind = kind});
    for (int k = 0; k < 30; ++k) tracker.learn(scene(k));
    EXPECT_FALSE(tracker.update(scene(40)).has_value()) << name_of(kind);
    const Ellipse truth{{70, 60}, 16, 9, 0.4};
    const auto found = tracker.update(scene(41, &truth));
    ASSERT_TRUE(found.has_value()) << name_of(kind);
    EXPECT_LT((found->center_px - truth.center_px).norm(), 0.6)
        << name_of(kind);  // px: moments of whole pixels
    EXPECT_NEAR(found->semi_major_px, 16, 1.5) << name_of(kind);
    EXPECT_NEAR(found->angle, 0.4, 0.1) << name_of(kind);
  }
}

TEST(BackgroundTracker, keeps_what_holds_still_only_when_fixed) {
  const Ellipse truth{{70, 60}, 16, 9, 0.4};
  BackgroundTracker fixed({.kind = BackgroundKind::fixed}),
      mixture({.kind = BackgroundKind::mog2, .rate = 0.1});
  for (int k = 0; k < 30; ++k) fixed.learn(scene(k)), mixture.learn(scene(k));
  bool kept = true, absorbed = false;
  for (int k = 0; k < 100; ++k) {
    kept = kept && fixed.update(scene(k, &truth)).has_value();
    absorbed = !mixture.update(scene(k, &truth)).has_value();
  }
  EXPECT_TRUE(kept);
  EXPECT_TRUE(absorbed) << "the reason why the loop's own tracker learns once";
}

TEST(BackgroundTracker, running_follows_a_lamp_that_fades) {
  BackgroundTracker fixed({.kind = BackgroundKind::fixed}),
      running({.kind = BackgroundKind::running, .rate = 0.1});
  for (int k = 0; k < 10; ++k) fixed.learn(scene(k)), running.learn(scene(k));
  const Ellipse truth{{70, 60}, 16, 9, 0.4};
  for (int k = 0; k < 60; ++k) running.update(scene(k) * (1 - 0.004 * k));
  const cv::Mat last = scene(60, &truth) * 0.76;
  ASSERT_TRUE(running.update(last).has_value());
  EXPECT_LT((running.update(last)->center_px - truth.center_px).norm(), 1.0);
  EXPECT_FALSE(fixed.update(last).has_value())
      << "all of the image differs: nothing in it can be the object";
}

TEST(BackgroundTracker, refuses_what_it_can_not_use) {
  BackgroundTracker tracker({});
  EXPECT_THROW(tracker.update(scene(0)), std::logic_error);
  EXPECT_THROW(tracker.learn(cv::Mat()), std::invalid_argument);
  EXPECT_THROW(tracker.learn(cv::Mat::zeros(4, 4, CV_32FC1)), std::invalid_argument);
  tracker.learn(scene(0));
  EXPECT_THROW(tracker.update(cv::Mat::zeros(4, 4, CV_8UC3)), std::invalid_argument);
  EXPECT_THROW(tracker.update(cv::Mat::zeros(120, 160, CV_8UC1)), std::invalid_argument);
  EXPECT_THROW(BackgroundTracker({.rate = 2}), std::invalid_argument);
  EXPECT_THROW(background_kind("gsoc"), std::invalid_argument);
  for (const BackgroundKind kind : kKinds) EXPECT_EQ(background_kind(name_of(kind)), kind);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
