// Several objects at once: apart, touching, alike, hidden; who is who stays true or is said to be
// lost.
// SPDX-License-Identifier: Apache-2.0
#include "tests/vision/several.h"

#include <gtest/gtest.h>

#include <cstdio>

namespace vitreo::vision::generated {
namespace VITREO_TEST_FILE {

void expect_good(const char* name, const SeveralScore& s, double center_px = 0.5) {
  std::printf("%-22s 4 objects, %d frames: lost %d, wrong %d, swapped %d, center %.2f px\n", name,
              s.frames, s.lost, s.wrong, s.swapped, s.center_px);
  EXPECT_EQ(s.lost, 0) << name;
  EXPECT_EQ(s.wrong, 0) << name;
  EXPECT_LT(s.center_px, center_px) << name;
}

TEST(MultiTracker, follows_a_robot_and_three_discs_of_other_colors_through_touch) {
  expect_good("colors, touching", score_several({.seed = 31, .meeting = Meeting::touching}, 66));
}

TEST(MultiTracker, follows_four_bodies_of_one_color_through_touch_over_a_fundus) {
  expect_good(
      "one color, touching",
      score_several({.seed = 32, .one_color = true, .meeting = Meeting::touching, .fundus = true},
                    66));
}

TEST(MultiTracker, never_takes_one_for_another_while_the_robot_is_hidden) {
  const SeveralScore s = score_several(
      {.seed = 33, .one_color = true, .meeting = Meeting::touching, .hidden_from = 18}, 50);
  EXPECT_EQ(s.wrong, 0);
  EXPECT_EQ(s.swapped, 0);
  // The robot and the disc beside it, two frames each until the find is believed, and one more
  // each.
  EXPECT_LE(s.lost, 6);
}

TEST(MultiTracker, of_one_object_gives_the_tracks_of_a_color_tracker_to_the_bit) {
  Sequence sequence({.seed = 34, .hidden_from = 8, .hidden_frames = 8});  // lost, and found again
  const ObjectModel model = ObjectModel::train(sequence.training(8), {}, {});
  ColorTracker alone(model, {});
  MultiTracker one({{model, {}}});
  int lost = 0, tracked = 0;
  for (int k = 0; k < 24; ++k) {
    const cv::Mat image = sequence.frame(k).image;
    const Track a = alone.update(image), b = one.update(image).front();
    ASSERT_EQ(a.state, b.state) << k;
    ASSERT_EQ(a.measured.has_value(), b.measured.has_value()) << k;
    ASSERT_EQ(a.expected.has_value(), b.expected.has_value()) << k;
    lost += a.state == TrackState::lost;
    if (a.expected) {
      EXPECT_EQ(a.expected->center_px, b.expected->center_px) << k;
    }
    if (!a.measured) continue;
    ++tracked;
    EXPECT_EQ(a.measured->ellipse.center_px, b.measured->ellipse.center_px) << k;
    EXPECT_EQ(a.measured->ellipse.angle, b.measured->ellipse.angle) << k;
    EXPECT_EQ(a.measured->covariance, b.measured->covariance) << k;
    EXPECT_EQ(a.support, b.support) << k;
  }
  EXPECT_GT(lost, 0);
  EXPECT_GT(tracked, 8);
}

/// Two discs of one color on a plain ground, where the caller wants them.
struct TwoDiscs {
  static Ellipse at(double u, double v) { return {{u, v}, 18, 17.5, 0.2}; }
  static Frame frame(const Ellipse& one, const Ellipse& other) {
    SequenceSettings settings;
    settings.size = {320, 240};
    settings.path = [one](int) { return one; };
    settings.companions = {{[other](int) { return other; }}};
    return Sequence(settings).frame(0);
  }
  static MultiTracker tracker() {
    std::vector<LabeledImage> images;
    for (const double u : {60.0, 90.0, 120.0, 150.0}) {
      const Ellipse one = at(u, 0.5 * u), other = at(-80, -80);
      images.push_back({frame(one, other).image, Sequence::mask_of(one, {320, 240})});
    }
    const ObjectModel model = ObjectModel::train(images, {}, {});
    return MultiTracker({{model, {}}, {model, {}}});
  }
};

TEST(MultiTracker,
     calls_two_alike_lost_when_one_runs_over_the_other_and_tells_them_apart_only_where_it_can) {
  MultiTracker tracker = TwoDiscs::tracker();
  ASSERT_TRUE(tracker.alike(0, 1));
  tracker.place(0, TwoDiscs::at(80, 120));
  tracker.place(1, TwoDiscs::at(200, 120));
  for (int k = 0; k <= 10; ++k) {
    const auto& tracks = tracker.update(
        TwoDiscs::frame(TwoDiscs::at(80 + 6 * k, 120), TwoDiscs::at(200 - 6 * k, 120)).image);
    for (int i = 0; i < 2; ++i) {
      if (tracks[static_cast<std::size_t>(i)].state != TrackState::tracking) continue;
      const double expected = i == 0 ? 80 + 6 * k : 200 - 6 * k;
      EXPECT_NEAR(tracks[static_cast<std::size_t>(i)].measured->ellipse.center_px.x(), expected, 10)
          << i << " " << k;
    }
  }
  // Both in one place, for long: which of them comes out on which side cannot be known.
  for (int k = 0; k < 8; ++k)
    tracker.update(TwoDiscs::frame(TwoDiscs::at(140, 120), TwoDiscs::at(140, 120)).image);
  const auto& tracks =
      tracker.update(TwoDiscs::frame(TwoDiscs::at(95, 120), TwoDiscs::at(185, 120)).image);
  EXPECT_FALSE(tracks[0].state == TrackState::tracking && tracks[1].state == TrackState::tracking);
  // A person who points ends it.
  tracker.place(0, TwoDiscs::at(95, 120));
  tracker.place(1, TwoDiscs::at(185, 120));
  for (const Track& track :
       tracker.update(TwoDiscs::frame(TwoDiscs::at(96, 120), TwoDiscs::at(184, 120)).image))
    EXPECT_EQ(track.state, TrackState::tracking);
}

TEST(MultiTracker, gives_every_pixel_to_the_nearer_of_two_that_touch) {
  MultiTracker tracker = TwoDiscs::tracker();
  tracker.place(0, TwoDiscs::at(100, 120));
  tracker.place(1, TwoDiscs::at(135.5, 120));
  tracker.update(TwoDiscs::frame(TwoDiscs::at(100, 120), TwoDiscs::at(135.5, 120)).image);
  EXPECT_EQ(tracker.owners().at<unsigned char>(120, 100), 1);
  EXPECT_EQ(tracker.owners().at<unsigned char>(120, 135), 2);
  EXPECT_EQ(tracker.owners().at<unsigned char>(120, 115), 1);
  EXPECT_EQ(tracker.owners().at<unsigned char>(120, 121), 2);
  EXPECT_EQ(tracker.owners().at<unsigned char>(10, 10), 0);
}

TEST(MultiTracker, refuses_what_it_can_not_use) {
  EXPECT_THROW(MultiTracker({}), std::invalid_argument);
  MultiTracker tracker = TwoDiscs::tracker();
  EXPECT_THROW(tracker.place(2, TwoDiscs::at(9, 9)), std::out_of_range);
  EXPECT_THROW(tracker.alike(0, 2), std::out_of_range);
  EXPECT_THROW(tracker.update(cv::Mat::zeros(240, 320, CV_8UC1)), std::invalid_argument);
  EXPECT_THROW(tracker.update(cv::Mat()), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision::generated
