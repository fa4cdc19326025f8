// The accuracy figures of the color tracker on generated sequences, whose seeds were not used to
// tune it.
// SPDX-License-Identifier: Apache-2.0
#include "tests/long_form.h"
#include "tests/vision/tracking_score.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

namespace vitreo::vision::generated {
namespace VITREO_TEST_FILE {

// The goals of the project: they leave the half pixel that highlights, shadow and the color mosaic
// move a rim.
void expect_accurate(const Score& score, double center_px) {
  EXPECT_EQ(score.lost, 0);
  EXPECT_EQ(score.wrong, 0);
  EXPECT_LE(score.center_px, center_px);
  EXPECT_LE(score.major_px, 2);
  EXPECT_LE(score.minor_px, 2);
  EXPECT_LE(score.angle_deg, 1.5);
}

void print(const char* name, const Score& s) {
  std::printf(
      "%-8s %d frames: lost %d, wrong %d, center %.2f px, major %.2f px, minor %.2f px, angle %.2f "
      "deg, %.0f %% "
      "inside\n",
      name, s.frames, s.lost, s.wrong, s.center_px, s.major_px, s.minor_px, s.angle_deg,
      100 * s.inside);
}

TEST(ColorTrackerAccuracy,
     places_the_robot_within_half_a_pixel_over_a_still_ground_and_says_how_well) {
  double inside = 0;
  const int seeds = long_or_short(6, 2);
  for (int k = 0; k < seeds; ++k) {
    const Score s = score({.seed = 901U + k}, 150);
    print("static", s);
    expect_accurate(s, 0.5);
    inside += s.inside / seeds;
  }
  // The bias that shadow and highlight cause changes slowly, so a sequence holds few independent
  // draws: they count together.
  EXPECT_GE(inside, 0.90);
  // The goal's other end is 0.99. Looks are believed for what they were worth in training with all
  // its disturbances, so a still ground comes out too cautious: 1.0 (docs/vision.md). What is
  // claimed is bounded instead: 0.21 px, 0.27 px while no look showed a shadow.
  Sequence sequence({.seed = 901});
  ColorTracker tracker(ObjectModel::train(sequence.training(24), {}, {}), {});
  double claimed = 0;
  int seen = 0;
  for (int k = 0; k < 40; ++k) {
    const Track track = tracker.update(sequence.frame(k).image);
    if (!track.measured) continue;
    claimed += std::sqrt(track.measured->covariance.topLeftCorner<2, 2>().trace() / 2);
    ++seen;
  }
  std::printf("claimed: %.2f px\n", claimed / seen);
  EXPECT_GE(seen, 38);
  EXPECT_LT(claimed / seen, 0.25) << "px, beside errors of 0.16 px in the mean";
}

TEST(ColorTrackerAccuracy, does_not_mind_a_ground_that_drifts) {
  for (const double drift : {1.0, 2.0}) {
    const Score s = score({.seed = 911, .drift_px = drift}, 150);
    print("drift", s);
    expect_accurate(s, 0.5);
  }
}

TEST(ColorTrackerAccuracy, holds_on_before_vessels_of_nearly_its_own_color) {
  const SequenceSettings vessels{.seed = 923, .dark_vessels = true};
  ColorModelSettings red_green;
  red_green.channels = channels_of("RG");
  const double r = ColorModel::train(Sequence(vessels).training(24), red_green).quality().mean;
  EXPECT_NEAR(r, 1.65, 0.15)
      << "the ground should be about as hard as the thesis' (table 8.2: 1.66)";
  for (const std::uint64_t seed : {923U, 924U}) {
    const Score s = score({.seed = seed, .dark_vessels = true}, 200);
    print("vessels", s);
    expect_accurate(s, 1.1);
  }
}

TEST(ColorTrackerAccuracy, follows_a_half_hidden_robot_and_is_never_wrong) {
  for (int k = 0; k < long_or_short(6, 2); ++k) {
    const Score s = score({.seed = 931U + k, .half_hidden_from = 40}, 90);
    print("half", s);
    EXPECT_LE(s.lost, 10);
    EXPECT_EQ(s.wrong, 0);
  }
}

TEST(ColorTrackerAccuracy,
     says_so_while_the_robot_is_hidden_and_finds_it_again_within_three_frames) {
  for (int k = 0; k < long_or_short(6, 2); ++k) {
    const Score s = score({.seed = 941U + k, .hidden_from = 40}, 90);
    print("hidden", s);
    EXPECT_EQ(s.hidden_tracked, 0);
    EXPECT_EQ(s.wrong, 0);
    EXPECT_EQ(s.lost, 0);
    ASSERT_TRUE(s.found_again_after.has_value());
    EXPECT_LE(*s.found_again_after, 3);
  }
}

TEST(ColorTrackerAccuracy, is_within_a_pixel_with_the_level_set_and_the_shape_prior_alone) {
  ColorTrackerSettings settings;
  settings.view.refine = false;
  const Score s = score({.seed = 951}, 150, settings);
  print("segment", s);
  expect_accurate(s, 0.5);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision::generated
