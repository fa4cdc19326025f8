// The work of one image's search: its bound, and what waits for the next image.
// SPDX-License-Identifier: Apache-2.0
#include "tests/vision/sequence_generator.h"
#include "vision/color_tracker.h"
#include "vision/evidence.h"
#include "vision/object_view.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>
#include <vector>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

const ObjectModel& model() {
  static const ObjectModel trained =
      ObjectModel::train(generated::Sequence({.seed = 3401}).training(12), {}, {});
  return trained;
}

generated::Frame frame(int k) { return generated::Sequence({.seed = 3401}).frame(k); }

// The image around an ellipse, so much larger: pasted elsewhere it is a body of that size.
cv::Mat body(const generated::Frame& from, double size) {
  const int reach = static_cast<int>(from.truth.semi_major_px) + 14;
  const cv::Rect part =
      cv::Rect(static_cast<int>(from.truth.center_px.x()) - reach,
               static_cast<int>(from.truth.center_px.y()) - reach, 2 * reach, 2 * reach) &
      cv::Rect({0, 0}, from.image.size());
  cv::Mat resized;
  cv::resize(from.image(part), resized, {}, size, size, cv::INTER_AREA);
  return resized;
}

void paste(const cv::Mat& what, cv::Mat& image, int u, int v) {
  what.copyTo(image(cv::Rect(u, v, what.cols, what.rows)));
}

// Half bodies: enough of a rim to be looked at twice, too little of it for a find.
cv::Mat halves(const cv::Mat& ground, const cv::Mat& one) {
  cv::Mat image = ground.clone();
  int k = 0;
  for (const auto& [u, v] :
       {std::pair{60, 60}, {300, 60}, {500, 60}, {60, 330}, {300, 330}, {500, 330}}) {
    paste(one, image, u, v);
    const int across = ++k % 2 == 0 ? one.cols / 2 : one.cols / 3;
    image(cv::Rect(u + across, v, one.cols - across, one.rows)).setTo(cv::Scalar(90, 90, 90));
  }
  return image;
}

cv::Mat ground_alone() {
  static const cv::Mat image =
      generated::Sequence({.seed = 3401, .hidden_from = 0, .hidden_frames = 400}).frame(0).image;
  return image;
}

std::vector<cv::Mat> hard_images() {
  const generated::Frame first = frame(0);
  const cv::Mat one = body(first, 1);
  std::vector<cv::Mat> images{halves(ground_alone(), one), halves(ground_alone(), body(first, 0.5)),
                              halves(ground_alone(), body(first, 1.4))};
  for (const double gain : {0.3, 0.6, 1.5}) images.push_back(gain * images[0]);
  cv::Mat noise(first.image.size(), CV_8UC3);
  cv::RNG random(5);
  random.fill(noise, cv::RNG::UNIFORM, 0, 256);
  images.push_back(noise);
  images.push_back(cv::Mat(first.image.size(), CV_8UC3, cv::mean(one)));
  return images;
}

// Lost in each of them, searched for long; and jumped to from a robot that was followed, in another
// light, which asks for the most.
TEST(SearchWork, an_image_costs_no_more_than_the_bound_whatever_it_shows) {
  double most = 0;
  for (const cv::Mat& image : hard_images()) {
    ColorTracker tracker(model(), {});
    for (int k = 0; k < 4; ++k) tracker.update(frame(k).image);
    ASSERT_EQ(tracker.state(), TrackState::tracking);
    for (int k = 0; k < 24; ++k) {
      const Track track = tracker.update(k % 7 == 6 ? cv::Mat(0.6 * image) : image);
      EXPECT_LE(track.work, ColorTracker::kMostWork);
      most = std::max(most, track.work);
    }
  }
  EXPECT_GT(most, 0.7 * ColorTracker::kMostWork);  // they do ask for all that there is
}

TEST(SearchWork, a_robot_that_is_followed_costs_one_look) {
  ColorTracker tracker(model(), {});
  Track track;
  for (int k = 0; k < 6; ++k) track = tracker.update(frame(k).image);
  ASSERT_EQ(track.state, TrackState::tracking);
  EXPECT_NEAR(track.work, 1, 0.05);
}

// The other ways wait for their turn, by one image at most: four sizes and no other light in eight
// images. What is seen of that size is a candidate then; to be believed it may have to move.
TEST(SearchWork, a_robot_of_another_size_among_hard_places_is_found_within_two_rounds) {
  const generated::Frame first = frame(0);
  for (const double size : {0.5, 0.7}) {
    cv::Mat image = halves(ground_alone(), body(first, 1));
    const cv::Mat one = body(first, size);
    paste(one, image, 420, 190);
    const Eigen::Vector2d at(420 + one.cols / 2.0, 190 + one.rows / 2.0);
    ColorTracker tracker(model(), {});
    int found = 0;
    for (int k = 1; k <= 8 && found == 0; ++k) {
      const Track track = tracker.update(image);
      if (track.candidate && (track.candidate->center_px - at).norm() < 5) found = k;
    }
    EXPECT_GT(found, 0) << "size " << size;
    std::printf("size %.1f: image %d\n", size, found);
  }
}

TEST(SearchWork, a_gate_full_of_the_objects_colors_is_told_before_a_front_is_sent) {
  const generated::Frame first = frame(0);
  const cv::Mat full(
      first.image.size(), CV_8UC3,
      cv::mean(first.image(cv::Rect(static_cast<int>(first.truth.center_px.x()) - 4,
                                    static_cast<int>(first.truth.center_px.y()) - 4, 9, 9))));
  ObjectView view(model(), {});
  const Ellipse at{{320, 240}, 30, 15, 0.4};
  const Observation seen = view.observe(full, at, 9, {at, 8, 2.5, 0.4});
  EXPECT_FALSE(seen.measured);
  EXPECT_EQ(seen.iterations, 0);
}

// F above 0 in the columns left of 100: what share of a disc of radius 40 at a chord's distance d
// from its center lies there is (acos(-d/r) r^2 + d sqrt(r^2 - d^2)) / (pi r^2).
TEST(Evidence, says_what_share_of_its_gate_has_f_above_a_value) {
  struct Left : EvidenceSource {
    void prepare(const cv::Mat&, const cv::Rect&) override {}
    void read(const cv::Mat&, int, int u, int step, int count, std::int8_t* to) const override {
      for (int k = 0; k < count; ++k)
        to[k] = static_cast<std::int8_t>(u + k * step < 100 ? 16 : -16);
    }
    void set_light(const LogColor&) override {}
  } left;
  const cv::Mat image(240, 320, CV_8UC3, cv::Scalar(0, 0, 0));
  constexpr double kRadius = 40;
  for (const double d : {-30.0, -10.0, 0.0, 20.0}) {
    Evidence evidence;
    evidence.look(image, left, {{99.5 - d, 120}, kRadius, kRadius, 0}, 200);
    const double share =
        (std::acos(-d / kRadius) * kRadius * kRadius + d * std::sqrt(kRadius * kRadius - d * d)) /
        (CV_PI * kRadius * kRadius);
    EXPECT_NEAR(evidence.share_above(0), share, 0.01) << d;  // a column is 0.016 of the disc
  }
  Evidence outside;
  outside.look(image, left, {{-200, -200}, kRadius, kRadius, 0}, 200);
  EXPECT_EQ(outside.share_above(0), 0);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
