// Ground ring against a reference that integrates along its circles, and the place of a find: what
// stands there still is no object that moved.
// SPDX-License-Identifier: Apache-2.0
#include "tests/vision/sequence_generator.h"
#include "vision/color_tracker.h"
#include "vision/ground_ring.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

constexpr double kApart_px = 8;   // of the two circles, as the header says
constexpr double kStructure = 5;  // gray levels of structure, below which nothing is told

// Smooth noise: its correlation length, about 8 px, is longer than the way between two samples on a
// circle of 30 px, so that 64 of them say about what all of it does.
cv::Mat ground(std::uint64_t seed, double deviation = 30) {
  cv::RNG random(seed);
  cv::Mat noise(240, 320, CV_32FC3);
  random.fill(noise, cv::RNG::NORMAL, 0, 1);
  cv::GaussianBlur(noise, noise, {}, 5);
  cv::Scalar mean, sigma;
  cv::meanStdDev(noise, mean, sigma);
  cv::Mat image;
  noise.convertTo(image, CV_8UC3, deviation / sigma[0], 128);
  return image;
}

// By another hand: the mean of the channels, bilinear, at a thousand places of each circle.
struct Circles {
  std::vector<double> gray;
  Circles(const cv::Mat& image, const Eigen::Vector2d& center, double radius) {
    for (const double r : {radius, radius + kApart_px})
      for (int k = 0; k < 1000; ++k) {
        const double t = 2 * std::numbers::pi * k / 1000;
        gray.push_back(at(image, center.x() + r * std::cos(t), center.y() + r * std::sin(t)));
      }
  }
  static double at(const cv::Mat& image, double u, double v) {
    const int i = static_cast<int>(std::floor(u)), j = static_cast<int>(std::floor(v));
    const double x = u - i, y = v - j;
    const auto mean = [&](int a, int b) {
      const auto& p = image.at<cv::Vec3b>(b, a);
      return (p[0] + p[1] + p[2]) / 3.0;
    };
    return (1 - y) * ((1 - x) * mean(i, j) + x * mean(i + 1, j)) +
           y * ((1 - x) * mean(i, j + 1) + x * mean(i + 1, j + 1));
  }
  double mean() const {
    double sum = 0;
    for (const double g : gray) sum += g;
    return sum / static_cast<double>(gray.size());
  }
  double deviation() const { return std::sqrt(product(*this)); }
  double product(const Circles& other) const {
    const double a = mean(), b = other.mean();
    double sum = 0;
    for (std::size_t k = 0; k < gray.size(); ++k) sum += (gray[k] - a) * (other.gray[k] - b);
    return sum / static_cast<double>(gray.size());
  }
  double correlation(const Circles& other) const {
    return product(other) / (deviation() * other.deviation());
  }
};

// Two grounds mixed to any correlation, at any place and radius; the verdict is the reference's
// wherever its correlation is not within what 64 samples scatter by.
TEST(GroundRing, judges_as_the_correlation_along_its_circles) {
  cv::RNG random(11);
  int same = 0, other = 0;
  for (int trial = 0; trial < 160; ++trial) {
    const cv::Mat one = ground(100 + static_cast<std::uint64_t>(trial));
    const double share = random.uniform(0.0, 1.0);
    cv::Mat two;
    cv::addWeighted(one, share, ground(900 + static_cast<std::uint64_t>(trial)), 1 - share, 0, two);
    const Eigen::Vector2d center(random.uniform(60.0, 260.0), random.uniform(60.0, 180.0));
    const double radius = random.uniform(8.0, 40.0);
    const Circles a(one, center, radius), b(two, center, radius);
    const double least = random.uniform(0.3, 0.95);
    const double above = a.correlation(b) - least;
    if (std::abs(above) < 0.12 || b.deviation() < 1.5 * kStructure) continue;
    ++(above > 0 ? same : other);
    EXPECT_EQ(GroundRing(one, center, radius).same_ground({two, center, radius}, least), above > 0)
        << "radius " << radius << ", correlation " << a.correlation(b) << ", least " << least;
  }
  EXPECT_GT(same, 20);
  EXPECT_GT(other, 20);
}

TEST(GroundRing, takes_another_lamp_for_the_same_ground_and_its_negative_for_another) {
  const cv::Mat one = ground(7);
  const GroundRing ring(one, {150, 120}, 25);
  EXPECT_TRUE(ring.same_ground({0.6 * one, {150, 120}, 25}, 0.99));
  EXPECT_TRUE(ring.same_ground({one + cv::Scalar(20, 20, 20), {150, 120}, 25}, 0.99));
  EXPECT_FALSE(ring.same_ground({cv::Scalar(255, 255, 255) - one, {150, 120}, 25}));
  EXPECT_FALSE(ring.same_ground({one, {190, 150}, 25}));  // another place of it
}

TEST(GroundRing, tells_nothing_where_there_is_no_structure) {
  EXPECT_FALSE(GroundRing().tells());
  EXPECT_FALSE(GroundRing(ground(8, 2), {150, 120}, 25).tells());
  EXPECT_TRUE(GroundRing(ground(8, 20), {150, 120}, 25).tells());
  EXPECT_FALSE(
      GroundRing(cv::Mat(240, 320, CV_8UC3, cv::Scalar(90, 80, 70)), {150, 120}, 25).tells());
}

// Where the circles are: what is within 2 px of neither may change as it will (a sample is a mean
// of 3 x 3 px at the nearest one), what is on either one may not.
TEST(GroundRing, reads_two_circles_that_are_eight_pixels_apart_and_nothing_else) {
  const Eigen::Vector2d center(150, 120);
  for (const double radius : {12.0, 20.5, 33.0}) {
    const cv::Mat one = ground(21), two = ground(22);
    cv::Mat near_them(one.size(), CV_8UC1, cv::Scalar(0));
    for (int v = 0; v < one.rows; ++v)
      for (int u = 0; u < one.cols; ++u) {
        const double r = std::hypot(u - center.x(), v - center.y());
        near_them.at<unsigned char>(v, u) =
            std::abs(r - radius) < 2.3 || std::abs(r - radius - kApart_px) < 2.3;
      }
    cv::Mat kept = two.clone();
    one.copyTo(kept, near_them);
    cv::Mat lost = one.clone();
    two.copyTo(lost, near_them);
    const GroundRing ring(one, center, radius);
    EXPECT_TRUE(ring.same_ground({kept, center, radius}, 0.9999)) << radius;
    EXPECT_FALSE(ring.same_ground({lost, center, radius}, 0.6)) << radius;
    // Each of the two circles alone decides as well.
    for (const double changed : {radius, radius + kApart_px}) {
      cv::Mat half = one.clone();
      for (int v = 0; v < one.rows; ++v)
        for (int u = 0; u < one.cols; ++u)
          if (std::abs(std::hypot(u - center.x(), v - center.y()) - changed) < 2.3)
            half.at<cv::Vec3b>(v, u) = two.at<cv::Vec3b>(v, u);
      EXPECT_FALSE(ring.same_ground({half, center, radius}, 0.9)) << radius << ' ' << changed;
    }
  }
}

// Around an ellipse: beyond its rim and its shadow, in the image's directions.
TEST(GroundRing, does_not_see_the_ellipse_nor_how_it_is_turned) {
  const cv::Mat one = ground(31), two = ground(32);
  const Ellipse at{{150, 120}, 30, 15, 0.7};
  cv::Mat covered = one.clone();
  cv::Mat mask(one.size(), CV_8UC1, cv::Scalar(0));
  cv::circle(mask, {150, 120}, 36, cv::Scalar(255), cv::FILLED);  // its rim and 6 px of shadow
  two.copyTo(covered, mask);
  EXPECT_TRUE(GroundRing(one, at).same_ground({covered, at}, 0.9999));
  Ellipse turned = at;
  turned.angle = -0.9;
  EXPECT_TRUE(GroundRing(one, at).same_ground({one, turned}, 0.9999));
  cv::circle(mask, {150, 120}, 56, cv::Scalar(255), cv::FILLED);
  two.copyTo(covered, mask);
  EXPECT_FALSE(GroundRing(one, at).same_ground({covered, at}));
}

TEST(GroundRing, is_not_troubled_by_the_border_of_an_image_nor_by_an_empty_one) {
  const cv::Mat one = ground(41);
  for (const Eigen::Vector2d& center :
       {Eigen::Vector2d(0, 0), Eigen::Vector2d(319, 239), Eigen::Vector2d(-500, 120)})
    GroundRing(one, center, 30).tells();
  EXPECT_FALSE(GroundRing(cv::Mat(2, 2, CV_8UC3, cv::Scalar(1, 2, 3)), {0, 0}, 5).tells());
}

// A tracker whose audit took anything: each find is doubtful until it has moved.
struct Doubted {
  generated::Sequence sequence{{.seed = 3501, .speed = 0}};
  ObjectModel model = [this] {
    ObjectModel trained = ObjectModel::train(sequence.training(8), {}, {});
    trained.audit.asked = 8;
    trained.audit.as_trained = {1, 50};  // no margin is ever sure
    trained.audit.resized = {1, 50};
    return trained;
  }();
};

// The image with what is around the robot cut out and laid elsewhere, over a ground without it.
cv::Mat robot_at(const Eigen::Vector2d& by) {
  generated::SequenceSettings settings{.seed = 3501, .speed = 0};
  const generated::Frame first = generated::Sequence(settings).frame(0);
  settings.path = [=](int) {
    Ellipse e = first.truth;
    e.center_px += by;
    return e;
  };
  return generated::Sequence(settings).frame(0).image;
}

TEST(FoundPlace, is_a_ring_across_the_rim_of_an_object_of_the_size_that_was_found) {
  Doubted doubted;
  ColorTracker tracker(doubted.model, {});
  const cv::Mat image = robot_at({0, 0});
  const Track track = tracker.update(image);
  ASSERT_TRUE(track.candidate);
  const TrackMemory& memory = tracker.memory();
  EXPECT_TRUE(memory.found_doubtful);
  EXPECT_LT((memory.found_px - track.candidate->center_px).norm(), 0.01);
  EXPECT_NEAR(memory.found_reach_px, track.candidate->semi_major_px, 0.01);
  // The short semi-axis that goes with the long one: inside the body across, at its rim along; the
  // outer circle is 8 px farther.
  const double thin =
      memory.found_reach_px * doubted.model.semi_axes_px.y() / doubted.model.semi_axes_px.x();
  EXPECT_TRUE(memory.found_place.tells());
  EXPECT_TRUE(memory.found_place.same_ground({image, memory.found_px, thin}, 0.97));
  EXPECT_FALSE(memory.found_place.same_ground({image, memory.found_px, thin + 9}, 0.97));
  EXPECT_FALSE(memory.found_place.same_ground({image, memory.found_px, thin - 7}, 0.97));
  EXPECT_TRUE(memory.found_ground.same_ground({image, *track.candidate}, 0.999));
}

TEST(FoundPlace, a_doubtful_find_that_stays_is_not_believed_and_one_that_leaves_is) {
  Doubted doubted;
  ColorTracker tracker(doubted.model, {});
  Track track;
  for (int k = 0; k < 12; ++k) track = tracker.update(robot_at({0, 0}));
  EXPECT_NE(track.state, TrackState::tracking);
  ASSERT_TRUE(track.candidate);
  int believed = 0;
  for (int k = 1; k <= 12 && believed == 0; ++k) {
    track = tracker.update(robot_at({3.0 * k, 0}));
    if (track.state == TrackState::tracking) believed = k;
  }
  // 5 px and four of its deviations: from the second step of 3 px on.
  EXPECT_GE(believed, 2);
  EXPECT_LE(believed, 8);
}

// The same look, as if it had been found 12 px beside: there stands what stood there then, so
// nothing has left that place; or other than then.
TEST(FoundPlace, what_was_found_where_all_is_as_it_was_has_not_moved) {
  Doubted doubted;
  const cv::Mat image = robot_at({0, 0});
  for (const bool as_it_was : {true, false}) {
    ColorTracker tracker(doubted.model, {});
    for (int k = 0; k < 6; ++k) tracker.update(image);
    TrackMemory memory = tracker.memory();
    ASSERT_GT(memory.agreed, 3);
    memory.found_px += Eigen::Vector2d(0, 12);
    const double thin =
        memory.found_reach_px * doubted.model.semi_axes_px.y() / doubted.model.semi_axes_px.x();
    const cv::Mat then = as_it_was ? image : robot_at({0, 12});
    memory.found_place = GroundRing(then, memory.found_px, thin);
    memory.found_ground = GroundRing(then, {memory.found_px, memory.found_reach_px, 1, 0});
    ASSERT_TRUE(memory.found_place.tells());
    tracker.restore(memory);
    EXPECT_EQ(tracker.update(image).state == TrackState::tracking, !as_it_was);
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
