// SPDX-License-Identifier: Apache-2.0
#include "vision/color_tracker.h"

#include "tests/vision/sequence_generator.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <vector>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

const ObjectModel& model() {
  static const ObjectModel trained =
      ObjectModel::train(generated::Sequence({.seed = 801}).training(12), {}, {});
  return trained;
}

std::vector<generated::Frame> frames_of(int count) {
  generated::Sequence sequence({.seed = 801});
  std::vector<generated::Frame> frames;
  for (int k = 0; k < count; ++k) frames.push_back(sequence.frame(k));
  return frames;
}

/// Once it is found a robot is believed.
const ColorTrackerSettings kAtOnce = [] {
  ColorTrackerSettings settings;
  settings.confirm_frames = 1;
  return settings;
}();

TEST(ColorTracker, finds_the_robot_in_the_first_frame_and_believes_it_in_the_third) {
  for (const std::uint64_t seed : {801U, 802U, 803U, 804U}) {
    generated::Sequence sequence({.seed = seed});
    ColorTracker tracker(ObjectModel::train(sequence.training(8), {}, {}), {});
    for (int k = 0; k < 2; ++k) {
      const generated::Frame before = sequence.frame(k);
      const Track found = tracker.update(before.image);
      ASSERT_EQ(found.state, TrackState::searching);
      ASSERT_TRUE(found.candidate);
      EXPECT_LT((found.candidate->center_px - before.truth.center_px).norm(), 1.5);
    }
    const generated::Frame frame = sequence.frame(2);
    const Track track = tracker.update(frame.image);
    ASSERT_EQ(track.state, TrackState::tracking);
    EXPECT_GT(track.margin.value(), 0);
    EXPECT_TRUE(track.self_measured);
    EXPECT_LT((track.measured->ellipse.center_px - frame.truth.center_px).norm(),
              1);  // px: twice the mean's goal
  }
}

TEST(ColorTracker, gives_the_same_tracks_for_the_same_images) {
  const auto frames = frames_of(12);
  ColorTracker one(model(), kAtOnce), other(model(), kAtOnce);
  for (const auto& frame : frames) {
    const Track a = one.update(frame.image), b = other.update(frame.image);
    ASSERT_EQ(a.state, b.state);
    ASSERT_TRUE(a.measured && b.measured);
    EXPECT_EQ(a.measured->ellipse.vector(), b.measured->ellipse.vector());
    EXPECT_EQ(a.measured->covariance, b.measured->covariance);
  }
}

TEST(ColorTracker, tracks_alike_with_a_model_that_was_saved_and_loaded) {
  const auto frames = frames_of(4);
  ColorTracker fresh(model(), kAtOnce), loaded(ObjectModel::load(model().save()), kAtOnce);
  for (const auto& frame : frames) {
    const Track a = fresh.update(frame.image), b = loaded.update(frame.image);
    ASSERT_TRUE(a.measured && b.measured);
    EXPECT_EQ(a.measured->ellipse.vector(), b.measured->ellipse.vector());
  }
}

TEST(ColorTracker, reports_nothing_in_blank_saturated_or_noisy_images_whatever_it_saw_before) {
  const auto frames = frames_of(2);
  for (const int kind : {0, 1, 2, 3}) {
    cv::Mat image(480, 640, CV_8UC3, cv::Scalar::all(kind == 0 ? 0 : (kind == 1 ? 255 : 90)));
    cv::RNG random(7);
    if (kind == 3) random.fill(image, cv::RNG::UNIFORM, 0, 256);
    ColorTracker tracker(model(), kAtOnce);
    EXPECT_EQ(tracker.update(image).state, TrackState::searching);
    tracker.update(frames[0].image);
    ASSERT_EQ(tracker.update(frames[1].image).state, TrackState::tracking);
    for (int k = 0; k < 8; ++k) {
      const Track track = tracker.update(image);
      EXPECT_EQ(track.state, k < 3 ? TrackState::coasting : TrackState::lost);
      EXPECT_FALSE(track.measured.has_value());
    }
    EXPECT_EQ(tracker.update(frames[1].image).state, TrackState::tracking);
  }
}

TEST(ColorTracker, starts_again_after_a_reset) {
  const auto frames = frames_of(1);
  ColorTracker tracker(model(), {});
  tracker.update(frames[0].image);
  tracker.reset();
  EXPECT_EQ(tracker.update(cv::Mat::zeros(480, 640, CV_8UC3)).state, TrackState::searching);
}

TEST(ColorTracker, follows_from_where_it_was_told) {
  const auto frames = frames_of(1);
  ColorTracker tracker(model(), {});
  Ellipse told = frames[0].truth;
  told.center_px += Eigen::Vector2d(4, -3);
  tracker.place(told);
  const Track track = tracker.update(frames[0].image);
  ASSERT_EQ(track.state, TrackState::tracking);
  EXPECT_LT((track.measured->ellipse.center_px - frames[0].truth.center_px).norm(), 1);
}

TEST(ColorTracker, survives_a_robot_at_every_edge_and_corner) {
  const cv::Mat image = frames_of(1)[0].image;
  ColorTracker tracker(model(), {});
  for (const double u : {0.0, 1.5, 320.0, 639.0}) {
    for (const double v : {0.0, 2.5, 240.0, 479.0}) {
      tracker.place({{u, v}, 30, 15, 0.4});
      for (int k = 0; k < 3; ++k) EXPECT_NO_THROW(tracker.update(image));
    }
  }
}

TEST(ColorTracker, refuses_what_it_can_not_use) {
  ColorTracker tracker(model(), {});
  EXPECT_THROW(tracker.update(cv::Mat::zeros(480, 640, CV_8UC1)), std::invalid_argument);
  EXPECT_THROW(tracker.update(cv::Mat::zeros(480, 640, CV_16UC3)), std::invalid_argument);
  EXPECT_THROW(tracker.update(cv::Mat(480, 640, CV_32FC3, cv::Scalar::all(std::nan("")))),
               std::invalid_argument);
  EXPECT_THROW(tracker.update(cv::Mat::zeros(240, 320, CV_8UC3)), std::invalid_argument);
  EXPECT_THROW(tracker.update(cv::Mat()), std::invalid_argument);
  EXPECT_THROW(tracker.place({{700, 10}, 30, 15, 0}), std::invalid_argument);
  EXPECT_THROW(tracker.place({{std::nan(""), 10}, 30, 15, 0}), std::invalid_argument);
  EXPECT_THROW(tracker.place({{10, 10}, 30, -15, 0}), std::invalid_argument);
  EXPECT_THROW(
      tracker.update(cv::Mat::zeros(480, 640, CV_8UC3), {cv::Mat::zeros(2, 2, CV_8UC1), 1}),
      std::invalid_argument);
  EXPECT_THROW(ColorTracker({}, {}), std::invalid_argument);
  ColorTrackerSettings settings;
  settings.candidates = 0;
  EXPECT_THROW(ColorTracker(model(), settings), std::invalid_argument);
}

TEST(ColorTracker, does_not_enter_what_another_object_owns) {
  const auto frame = frames_of(1)[0];
  ColorTracker tracker(model(), kAtOnce);
  const cv::Mat owned(480, 640, CV_8UC1, cv::Scalar(2));
  EXPECT_EQ(tracker.update(frame.image, {owned, 1}).state, TrackState::searching);
  EXPECT_EQ(tracker.update(frame.image, {owned, 2}).state, TrackState::tracking);
}

TEST(ObjectModel, is_not_bent_by_a_stray_dot_or_a_body_that_the_edge_cuts) {
  std::vector<LabeledImage> images = generated::Sequence({.seed = 805}).training(5);
  const ObjectModel clean = ObjectModel::train(images, {}, {});
  images[1].mask.at<unsigned char>(2, 630) = 255;
  generated::Sequence cut({.seed = 805, .path = [](int) {
                             return Ellipse{{4, 200}, 30, 15, 0.3};
                           }});
  const generated::Frame half = cut.frame(0);
  images.push_back({half.image, generated::Sequence::mask_of(half.truth, half.image.size())});
  const ObjectModel model = ObjectModel::train(images, {}, {});
  EXPECT_LT((model.semi_axes_px - clean.semi_axes_px).norm(), 0.05);
  EXPECT_LT((model.rim.covariance - clean.rim.covariance).norm(), 0.01);
}

TEST(ObjectModel, refuses_damaged_bytes) {
  const std::string bytes = model().save();
  for (std::size_t k = 0; k < bytes.size(); k += bytes.size() / 50) {
    std::string damaged = bytes;
    damaged[k] = static_cast<char>(damaged[k] ^ 0x10);
    EXPECT_THROW(ObjectModel::load(damaged), std::invalid_argument) << k;
    EXPECT_THROW(ObjectModel::load(bytes.substr(0, k)), std::invalid_argument) << k;
  }
  EXPECT_THROW(ObjectModel::load(bytes + "x"), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
