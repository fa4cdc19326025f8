// SPDX-License-Identifier: Apache-2.0
#include "vision/registration.h"

#include "tests/vision/retina.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <iostream>
#include <limits>
#include <stdexcept>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

constexpr double kDegree = std::numbers::pi / 180;

const cv::Mat& picture() {
  static const cv::Mat image = synthetic::retina({1500, 1200}, 11);
  return image;
}

// Root mean square over the points of the second view that the first shows.
double error_px(const Eigen::Affine2d& first_from_second, const Eigen::Affine2d& truth) {
  double sum = 0;
  int count = 0;
  for (int v = 0; v < 480; v += 30) {
    for (int u = 0; u < 640; u += 30) {
      const Eigen::Vector2d p(u, v), q = truth * p;
      if (q.x() < 0 || q.y() < 0 || q.x() > 639 || q.y() > 479) continue;
      sum += (first_from_second * p - q).squaredNorm();
      ++count;
    }
  }
  return std::sqrt(sum / count);
}

struct Pair {
  cv::Mat first, second;
  Eigen::Affine2d first_from_second;
};

// Shifted by 100 to 300 px any way, turned by up to 25 degrees.
Pair random_pair(std::mt19937_64& random,
                 const Eigen::Matrix2d& shear = Eigen::Matrix2d::Identity()) {
  std::uniform_real_distribution<double> unit(-1, 1);
  const double length = 200 + 100 * unit(random), way = std::numbers::pi * unit(random);
  const double turn = 25 * kDegree * unit(random), u = unit(random), v = unit(random),
               turned = 0.2 * unit(random);
  const Eigen::Vector2d at(750 + 100 * u, 600 + 50 * v),
      shift(length * std::cos(way), length * std::sin(way));
  const Eigen::Affine2d first = synthetic::picture_from_view(at, turned);
  Eigen::Affine2d second = synthetic::picture_from_view(at + shift, turned + turn);
  second.linear() *= shear;
  synthetic::ViewLook brighter;
  brighter.light = 1.15;
  const cv::Mat a = synthetic::view_of(picture(), first, {}, random);
  return {a, synthetic::view_of(picture(), second, brighter, random), first.inverse() * second};
}

TEST(Registration, of_turned_shifted_noisy_vignetted_views_is_right_to_a_tenth_of_a_pixel) {
  std::mt19937_64 random(1);
  const RegistrationSettings settings;
  double squares = 0, variances = 0;
  constexpr int kPairs = 20;
  for (int k = 0; k < kPairs; ++k) {
    const Pair pair = random_pair(random);
    const RegistrationView first(pair.first, settings), second(pair.second, settings);
    const auto found = register_views(first, second, settings);
    ASSERT_TRUE(found) << k;
    const double error = error_px(found->first_from_second, pair.first_from_second);
    EXPECT_LT(error, 0.1) << k;  // a third of what the mosaic may have
    squares += error * error;
    variances += found->sigma_px * found->sigma_px;
  }
  std::cout << "registration: rms " << std::sqrt(squares / kPairs) << " px, claimed "
            << std::sqrt(variances / kPairs) << " px\n";
  EXPECT_GT(variances,
            squares / 4);  // the error is what was claimed, within a factor of two either way
  EXPECT_LT(variances, squares * 4);
}

TEST(Registration, finds_scale_and_shear_when_they_are_allowed) {
  std::mt19937_64 random(2);
  RegistrationSettings settings;
  settings.model = ViewModel::affine;
  for (int k = 0; k < 5; ++k) {
    const Pair pair =
        random_pair(random, (Eigen::Matrix2d() << 1.01, 0.008, -0.004, 0.99).finished());
    const RegistrationView first(pair.first, settings), second(pair.second, settings);
    const auto found = register_views(first, second, settings);
    ASSERT_TRUE(found) << k;
    EXPECT_LT(error_px(found->first_from_second, pair.first_from_second), 0.2)
        << k;  // twice as many unknowns
  }
}

// Three lens reflexes, white, where the sensor has them.
void add_reflexes(cv::Mat& view) {
  for (const auto& [center, sigma] : {std::pair(cv::Point(180, 150), 9.0),
                                      {cv::Point(450, 120), 7.0},
                                      {cv::Point(330, 360), 12.0}}) {
    for (int v = 0; v < view.rows; ++v) {
      for (int u = 0; u < view.cols; ++u) {
        const double r2 = (u - center.x) * (u - center.x) + (v - center.y) * (v - center.y);
        const double more = 520 * std::exp(-r2 / (2 * sigma * sigma));
        auto& at = view.at<unsigned char>(v, u);
        at = cv::saturate_cast<unsigned char>(at + more);
      }
    }
  }
}

TEST(Registration, is_not_fooled_by_reflexes_that_are_fixed_in_the_image) {
  std::mt19937_64 random(21);
  const RegistrationSettings settings;
  int right = 0, wrong = 0;
  constexpr int kPairs = 8;
  for (int k = 0; k < kPairs; ++k) {
    Pair pair = random_pair(random);
    add_reflexes(pair.first);
    add_reflexes(pair.second);
    const auto found = register_views(RegistrationView(pair.first, settings),
                                      RegistrationView(pair.second, settings), settings);
    if (found) ++(error_px(found->first_from_second, pair.first_from_second) < 1 ? right : wrong);
  }
  std::cout << "reflexes: " << right << " right, " << wrong << " wrong of " << kPairs << "\n";
  EXPECT_EQ(wrong, 0);
  EXPECT_GE(right, 7);
}

// Other parts of a retina behind the same dirt, which is dark and saturates nothing.
TEST(Registration, refuses_views_that_agree_on_the_dirt_of_the_sensor_alone) {
  std::mt19937_64 random(22);
  const RegistrationSettings settings;
  for (int k = 0; k < 6; ++k) {
    cv::Mat first = synthetic::view_of(picture(), synthetic::picture_from_view({700, 600}, 0.2 * k),
                                       {}, random);
    const cv::Mat other = synthetic::retina({800, 640}, 300 + static_cast<std::uint64_t>(k));
    cv::Mat second =
        synthetic::view_of(other, synthetic::picture_from_view({400, 320}, 0), {}, random);
    for (cv::Mat* view : {&first, &second})
      for (const cv::Point& at : {cv::Point(120, 90), {300, 250}, {500, 330}, {210, 400}})
        cv::circle(*view, at, 12, cv::Scalar(40), cv::FILLED, cv::LINE_AA);
    EXPECT_FALSE(register_views(RegistrationView(first, settings),
                                RegistrationView(second, settings), settings))
        << k;
  }
}

TEST(Registration, follows_a_zoom_of_a_tenth) {
  std::mt19937_64 random(23);
  const RegistrationSettings settings;
  int right = 0, wrong = 0;
  for (const double zoom : {0.9, 0.97, 1.03, 1.1}) {
    for (int k = 0; k < 2; ++k) {
      const Pair pair = random_pair(random, zoom * Eigen::Matrix2d::Identity());
      const auto found = register_views(RegistrationView(pair.first, settings),
                                        RegistrationView(pair.second, settings), settings);
      if (found) ++(error_px(found->first_from_second, pair.first_from_second) < 1 ? right : wrong);
    }
  }
  std::cout << "zoom: " << right << " right, " << wrong << " wrong of 8\n";
  EXPECT_EQ(wrong, 0);
  EXPECT_GE(right, 4);  // the others are refused: the search has no scale of its own
}

TEST(Registration, works_where_vessels_are_faint) {
  const cv::Mat faint = 120 + 0.3 * (picture() - 120);
  std::mt19937_64 random(3);
  const RegistrationSettings settings;
  const Eigen::Affine2d a = synthetic::picture_from_view({700, 600}, 0),
                        b = synthetic::picture_from_view({880, 680}, 0.3);
  const RegistrationView first(synthetic::view_of(faint, a, {}, random), settings);
  const RegistrationView second(synthetic::view_of(faint, b, {}, random), settings);
  const auto found = register_views(first, second, settings);
  ASSERT_TRUE(found);
  EXPECT_LT(error_px(found->first_from_second, a.inverse() * b),
            0.3);  // a third of the contrast, three times the error
}

TEST(Registration, finds_nothing_where_there_is_nothing_in_common) {
  std::mt19937_64 random(4);
  const RegistrationSettings settings;
  int wrong = 0;
  double highest = 0;
  for (int k = 0; k < 12; ++k) {
    const cv::Mat other = synthetic::retina({800, 640}, 100 + static_cast<std::uint64_t>(k));
    const RegistrationView first(
        synthetic::view_of(picture(), synthetic::picture_from_view({750, 600}, 0.5 * k), {},
                           random),
        settings);
    const RegistrationView second(
        synthetic::view_of(other, synthetic::picture_from_view({400, 320}, 0), {}, random),
        settings);
    const auto found = register_views(first, second, settings);
    if (found) ++wrong, highest = std::max(highest, found->correlation);
  }
  EXPECT_EQ(wrong, 0) << "correlation up to " << highest;
}

TEST(Registration, finds_nothing_in_blank_saturated_or_merely_noisy_views) {
  std::mt19937_64 random(5);
  const RegistrationSettings settings;
  const RegistrationView good(
      synthetic::view_of(picture(), synthetic::picture_from_view({750, 600}, 0), {}, random),
      settings);
  for (const int level : {0, 128, 255}) {
    const RegistrationView flat(cv::Mat(480, 640, CV_8U, cv::Scalar(level)), settings);
    EXPECT_TRUE(flat.blank());
    EXPECT_FALSE(register_views(good, flat, settings)) << level;
    EXPECT_FALSE(register_views(flat, flat, settings)) << level;
  }
  const cv::Mat gray(600, 800, CV_32F, cv::Scalar(120));
  const Eigen::Affine2d middle = synthetic::picture_from_view({400, 300}, 0);
  const RegistrationView noise(synthetic::view_of(gray, middle, {}, random), settings);
  const RegistrationView more(synthetic::view_of(gray, middle, {}, random), settings);
  EXPECT_FALSE(register_views(good, noise, settings));
  EXPECT_FALSE(register_views(noise, more, settings));
}

TEST(Registration, takes_color_by_its_green) {
  std::mt19937_64 random(6);
  const cv::Mat green =
      synthetic::view_of(picture(), synthetic::picture_from_view({700, 500}, 0), {}, random);
  cv::Mat color;
  cv::merge(std::vector<cv::Mat>{cv::Mat::zeros(green.size(), CV_8U), green, 255 - green}, color);
  const RegistrationSettings settings;
  const auto found = register_views(RegistrationView(green, settings),
                                    RegistrationView(color, settings), settings);
  ASSERT_TRUE(found);
  EXPECT_TRUE(
      found->first_from_second.isApprox(Eigen::Affine2d::Identity(), 1e-6));  // the same pixels
}

TEST(Registration, refuses_images_and_settings_that_make_no_sense) {
  const RegistrationSettings settings;
  const cv::Mat image(100, 100, CV_8U, cv::Scalar(9));
  EXPECT_THROW(RegistrationView({}, settings), std::invalid_argument);
  EXPECT_THROW(RegistrationView(cv::Mat(100, 100, CV_32F, cv::Scalar(0)), settings),
               std::invalid_argument);
  EXPECT_THROW(RegistrationView(cv::Mat(100, 63, CV_8U, cv::Scalar(0)), settings),
               std::invalid_argument);
  const cv::Mat wider(100, 101, CV_8U, cv::Scalar(9));
  EXPECT_THROW(register_views(RegistrationView(image, settings), RegistrationView(wider, settings),
                              settings),
               std::invalid_argument);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (double RegistrationSettings::*field :
       {&RegistrationSettings::max_rotation, &RegistrationSettings::min_overlap,
        &RegistrationSettings::flatten_sigma_px, &RegistrationSettings::min_correlation}) {
    RegistrationSettings bad;
    bad.*field = nan;
    EXPECT_THROW(RegistrationView(image, bad), std::invalid_argument);
  }
  Eigen::Affine2d lost = Eigen::Affine2d::Identity();
  lost.translation() = Eigen::Vector2d(nan, 5);
  std::mt19937_64 random(7);
  const RegistrationView view(
      synthetic::view_of(picture(), synthetic::picture_from_view({700, 500}, 0), {}, random),
      settings);
  EXPECT_THROW(refine_registration(view, view, lost, settings), std::invalid_argument);
  lost.translation() = Eigen::Vector2d(5000, 5);
  EXPECT_FALSE(refine_registration(view, view, lost, settings));
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
