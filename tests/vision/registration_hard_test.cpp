// Registration of views that invite a wrong answer: reflexes and dirt fixed to the sensor, a zoom,
// a barrel distortion, one view twice. What is accepted is right to a pixel, and knows how right.
// SPDX-License-Identifier: Apache-2.0
#include "tests/long_form.h"
#include "tests/vision/retina.h"
#include "vision/mosaic.h"
#include "vision/registration.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <functional>
#include <iostream>
#include <string>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

constexpr double kDegree = std::numbers::pi / 180;
const cv::Size kView(640, 480);

// What is done to both views of a pair, after the sensor.
using Fault = std::function<void(cv::Mat&)>;

// Where the ideal view has what the distorted one shows at a pixel: r' = r (1 + k (r / R)^2), R the
// half diagonal, so the corner is seen k too far in.
Eigen::Vector2d undistorted(const Eigen::Vector2d& p, double k) {
  const Eigen::Vector2d center((kView.width - 1) / 2.0, (kView.height - 1) / 2.0);
  const Eigen::Vector2d from = p - center;
  return center + from * (1 + k * from.squaredNorm() / center.squaredNorm());
}

Eigen::Vector2d distorted(const Eigen::Vector2d& ideal, double k) {
  Eigen::Vector2d p = ideal;
  for (int round = 0; round < 20; ++round) p += ideal - undistorted(p, k);
  return p;
}

struct HardPair {
  cv::Mat first, second;
  Eigen::Affine2d first_from_second;
  double barrel = 0;
  // Root mean square over the pixels of the second view that the first shows.
  double error_px(const Eigen::Affine2d& found) const {
    double sum = 0;
    int count = 0;
    for (int v = 0; v < kView.height; v += 20) {
      for (int u = 0; u < kView.width; u += 20) {
        const Eigen::Vector2d p(u, v);
        const Eigen::Vector2d q = distorted(first_from_second * undistorted(p, barrel), barrel);
        if (q.x() < 0 || q.y() < 0 || q.x() > 639 || q.y() > 479) continue;
        sum += (found * p - q).squaredNorm();
        ++count;
      }
    }
    return std::sqrt(sum / std::max(count, 1));
  }
};

cv::Mat with_barrel(const cv::Mat& picture, const Eigen::Affine2d& picture_from_view, double barrel,
                    std::mt19937_64& random) {
  if (barrel == 0) return synthetic::view_of(picture, picture_from_view, {}, random);
  cv::Mat at(kView, CV_32FC2), seen;
  for (int v = 0; v < kView.height; ++v) {
    for (int u = 0; u < kView.width; ++u) {
      const Eigen::Vector2d p = picture_from_view * undistorted({u, v}, barrel);
      at.at<cv::Vec2f>(v, u) = {static_cast<float>(p.x()), static_cast<float>(p.y())};
    }
  }
  cv::remap(picture, seen, at, cv::noArray(), cv::INTER_CUBIC, cv::BORDER_REFLECT);
  return synthetic::view_of(seen, Eigen::Affine2d::Identity(), {}, random);
}

struct Case {
  std::string name;
  double zoom = 1;  // of the second view
  double barrel = 0;
  double least_shift = 100;
  double most_shift = 300;
  double turn = 25 * kDegree;
  Fault fault = nullptr;
  bool elsewhere = false;  // the second view is of another retina
};

HardPair pair_of(const Case& hard, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  const cv::Mat picture = synthetic::retina({1500, 1200}, 500 + seed);
  std::uniform_real_distribution<double> unit(-1, 1);
  const double length =
      (hard.most_shift + hard.least_shift + (hard.most_shift - hard.least_shift) * unit(random)) /
      2;
  const double way = std::numbers::pi * unit(random), turned = 0.2 * unit(random);
  const double turn = hard.turn * unit(random), u = unit(random), v = unit(random);
  const Eigen::Vector2d at(750 + 100 * u, 600 + 50 * v);
  const Eigen::Vector2d shift(length * std::cos(way), length * std::sin(way));
  const Eigen::Affine2d first = synthetic::picture_from_view(at, turned);
  Eigen::Affine2d second = synthetic::picture_from_view(at + shift, turned + turn);
  const Eigen::Vector2d center((kView.width - 1) / 2.0, (kView.height - 1) / 2.0);
  second = second * Eigen::Translation2d(center) * Eigen::Scaling(1 / hard.zoom) *
           Eigen::Translation2d(-center);
  const cv::Mat other = hard.elsewhere ? synthetic::retina({1500, 1200}, 900 + seed) : picture;
  HardPair pair{with_barrel(picture, first, hard.barrel, random),
                with_barrel(other, second, hard.barrel, random), first.inverse() * second,
                hard.barrel};
  if (hard.fault)
    for (cv::Mat* view : {&pair.first, &pair.second}) hard.fault(*view);
  return pair;
}

struct Count {
  int right = 0;
  int wrong = 0;  // accepted beyond a pixel
  int refused = 0;
  double squares = 0;    // px^2, of the right ones
  double variances = 0;  // px^2, claimed
  double ratio() const { return std::sqrt(variances / squares); }
};

Count count_of(const Case& hard, int pairs, std::uint64_t seed = 1) {
  Count count;
  const RegistrationSettings settings;
  for (int k = 0; k < pairs; ++k) {
    const HardPair pair = pair_of(hard, seed + static_cast<std::uint64_t>(k));
    const auto found = register_views(RegistrationView(pair.first, settings),
                                      RegistrationView(pair.second, settings), settings);
    if (!found) {
      ++count.refused;
      continue;
    }
    const double error = pair.error_px(found->first_from_second);
    ++(error < 1 ? count.right : count.wrong);
    if (error < 1) count.squares += error * error;
    if (error < 1) count.variances += found->sigma_px * found->sigma_px;
  }
  std::cout << hard.name << ": " << count.right << " right, " << count.wrong << " wrong, "
            << count.refused << " refused of " << pairs << "; rms "
            << std::sqrt(count.squares / std::max(count.right, 1)) << " px, claimed "
            << count.ratio() << " times that\n";
  return count;
}

void expect_honest(const Count& count) {
  EXPECT_EQ(count.wrong, 0);
  if (count.right < 3) return;  // too few for a root mean square
  EXPECT_GT(count.ratio(), 0.5);
  EXPECT_LT(count.ratio(), 2);
}

// White, with flanks, larger and smaller ones.
void reflexes(cv::Mat& view) {
  for (const auto& [center, sigma] : {std::pair(cv::Point(180, 150), 9.0),
                                      {cv::Point(450, 120), 7.0},
                                      {cv::Point(330, 360), 12.0}}) {
    for (int v = 0; v < view.rows; ++v) {
      for (int u = 0; u < view.cols; ++u) {
        const double r2 = (u - center.x) * (u - center.x) + (v - center.y) * (v - center.y);
        auto& at = view.at<unsigned char>(v, u);
        at = cv::saturate_cast<unsigned char>(at + 520 * std::exp(-r2 / (2 * sigma * sigma)));
      }
    }
  }
}

// Reflexes of 60 gray levels: of a coated lens, that saturate nothing.
void faint_reflexes(cv::Mat& view) {
  cv::RNG random(77);
  for (int k = 0; k < 24; ++k) {
    const cv::Point center(random.uniform(30, view.cols - 30), random.uniform(30, view.rows - 30));
    const double sigma = random.uniform(4.0, 9.0);
    for (int v = std::max(center.y - 30, 0); v < std::min(center.y + 31, view.rows); ++v) {
      for (int u = std::max(center.x - 30, 0); u < std::min(center.x + 31, view.cols); ++u) {
        const double r2 = (u - center.x) * (u - center.x) + (v - center.y) * (v - center.y);
        auto& at = view.at<unsigned char>(v, u);
        at = cv::saturate_cast<unsigned char>(at + 60 * std::exp(-r2 / (2 * sigma * sigma)));
      }
    }
  }
}

// A sensor that was not cleaned: dark specks all over it.
void dirt(cv::Mat& view) {
  cv::RNG random(78);
  for (int k = 0; k < 60; ++k)
    cv::circle(view, {random.uniform(10, view.cols - 10), random.uniform(10, view.rows - 10)},
               random.uniform(3, 10), cv::Scalar(45), cv::FILLED, cv::LINE_AA);
}

TEST(RegistrationHard, reflexes_that_saturate_and_are_fixed_in_the_image) {
  const int pairs = long_or_short(64, 8);
  const Count count = count_of({.name = "reflexes", .fault = reflexes}, pairs);
  expect_honest(count);
  EXPECT_GE(count.right, 0.75 * pairs);
}

TEST(RegistrationHard, reflexes_that_saturate_nothing) {
  const int pairs = long_or_short(64, 8);
  const Count count = count_of({.name = "faint reflexes", .fault = faint_reflexes}, pairs);
  expect_honest(count);
  EXPECT_GE(count.right, 0.5 * pairs);
}

TEST(RegistrationHard, dirt_all_over_the_sensor) {
  const int pairs = long_or_short(64, 8);
  const Count count = count_of({.name = "dirt", .fault = dirt}, pairs);
  expect_honest(count);
  EXPECT_GE(count.right, 0.5 * pairs);
}

TEST(RegistrationHard, other_retinas_behind_the_same_dirt_and_reflexes_are_refused) {
  for (const auto& [name, fault] : {std::pair<std::string, Fault>("dirt", dirt),
                                    {"faint reflexes", faint_reflexes},
                                    {"reflexes", reflexes}}) {
    const int pairs = long_or_short(32, 4);
    const Count count =
        count_of({.name = "elsewhere, " + name, .fault = fault, .elsewhere = true}, pairs, 30);
    EXPECT_EQ(count.refused, pairs);
  }
}

TEST(RegistrationHard, a_view_that_did_not_move_behind_the_dirt_is_found_in_its_place) {
  const Count count = count_of(
      {.name = "at rest, dirt", .least_shift = 0, .most_shift = 1, .turn = 0, .fault = dirt}, 6);
  expect_honest(count);
  EXPECT_GE(count.right, 5);
}

TEST(RegistrationHard, a_zoom_of_a_tenth_either_way) {
  int right = 0;
  const int pairs = long_or_short(16, 4);
  for (const double zoom : {0.9, 0.95, 1.05, 1.1}) {
    const Count count = count_of({.name = "zoom " + std::to_string(zoom), .zoom = zoom}, pairs, 40);
    expect_honest(count);
    right += count.right;
  }
  EXPECT_GE(right, 0.75 * 4 * pairs);
}

TEST(RegistrationHard, a_barrel_of_three_percent_is_refused_where_a_similarity_does_not_fit) {
  const int pairs = long_or_short(20, 4);
  for (const double barrel : {0.03, -0.03}) {
    expect_honest(count_of({.name = "barrel, far", .barrel = barrel}, pairs, 60));
    expect_honest(
        count_of({.name = "barrel, near", .barrel = barrel, .least_shift = 10, .most_shift = 80},
                 pairs, 80));
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
