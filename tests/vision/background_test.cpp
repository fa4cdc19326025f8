// SPDX-License-Identifier: Apache-2.0
#include "vision/background.h"

#include "tests/vision/synthetic.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <stdexcept>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

using namespace synthetic;

double expected_noise(const Scene& scene, double level) {
  const double gain = 255 / scene.full_well;
  return std::sqrt(gain * level + std::pow(gain * scene.read_noise, 2) +
                   1.0 / 12);  // with the rounding to gray levels
}

TEST(Background, learns_the_mean_of_the_empty_scene) {
  const Scene scene;
  std::mt19937_64 random(1);
  const cv::Mat ground = ground_of(scene);
  const Background background = learnt(ground, scene, random, 16);
  EXPECT_EQ(background.count(), 16);
  // Noise below 1.4 gray levels, a quarter of that in the mean of 16.
  EXPECT_LT(cv::norm(background.mean(), ground, cv::NORM_L2) / std::sqrt(ground.total()), 0.4);
}

TEST(Background, finds_shot_and_read_noise_from_a_few_images) {
  Scene scene;
  for (const double read_noise : {15.0, 200.0}) {
    scene.read_noise = read_noise;
    std::mt19937_64 random(2);
    const cv::Mat noise = learnt(ground_of(scene), scene, random, 5).noise_of_level();
    ASSERT_EQ(noise.size(), cv::Size(256, 1));
    // Pooled over 300 000 pixels: the level's slope is the weak point, where the scene does not go,
    // at 30.
    for (const double level : {80.0, 125.0, 140.0}) {
      EXPECT_NEAR(noise.at<float>(static_cast<int>(level)), expected_noise(scene, level), 0.05);
    }
    EXPECT_NEAR(noise.at<float>(30), expected_noise(scene, 30), 0.3);
  }
}

TEST(Background, errs_towards_more_noise_from_a_single_image) {
  const Scene scene;
  std::mt19937_64 random(3);
  const float noise = learnt(ground_of(scene), scene, random, 1).noise_of_level().at<float>(125);
  EXPECT_GE(noise, 0.9 * expected_noise(scene, 125));
  EXPECT_LE(noise, 2.5 * expected_noise(scene, 125));  // the vessels' edges count as noise
}

TEST(Background, never_claims_less_noise_than_the_rounding_to_gray_levels) {
  Background background;
  for (int k = 0; k < 3; ++k) background.learn(cv::Mat(20, 30, CV_8U, cv::Scalar(77)));
  EXPECT_NEAR(background.noise_of_level().at<float>(77), std::sqrt(1.0 / 12), 1e-6);
  Background black;
  for (int k = 0; k < 3; ++k) black.learn(cv::Mat::zeros(20, 30, CV_8U));
  EXPECT_GT(black.noise_of_level().at<float>(255), 0);
}

TEST(Background, goes_on_learning_after_it_was_asked) {
  Background background;
  background.learn(cv::Mat(4, 4, CV_8U, cv::Scalar(10)));
  EXPECT_EQ(background.mean().at<float>(0, 0), 10);
  background.learn(cv::Mat(4, 4, CV_8U, cv::Scalar(20)));
  EXPECT_EQ(background.mean().at<float>(0, 0), 15);
}

TEST(Background, refuses_other_sizes_and_types_and_to_speak_before_it_has_seen) {
  Background background;
  EXPECT_THROW(static_cast<void>(background.mean()), std::logic_error);
  EXPECT_THROW(static_cast<void>(background.noise_of_level()), std::logic_error);
  EXPECT_THROW(background.learn(cv::Mat()), std::invalid_argument);
  EXPECT_THROW(background.learn(cv::Mat(4, 4, CV_16U)), std::invalid_argument);
  background.learn(cv::Mat::zeros(4, 4, CV_8U));
  EXPECT_THROW(background.learn(cv::Mat::zeros(4, 5, CV_8U)), std::invalid_argument);
  EXPECT_EQ(background.count(), 1);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
