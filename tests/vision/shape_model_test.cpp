// SPDX-License-Identifier: Apache-2.0
#include "vision/shape_model.h"

#include "tests/vision/sequence_generator.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <vector>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

using generated::Sequence;

// Ellipses of one area whose aspect alone varies, anywhere, at any angle.
std::vector<cv::Mat> masks_of(int count) {
  std::vector<cv::Mat> masks;
  for (int k = 0; k < count; ++k) {
    const double aspect = 1.6 + 0.8 * k / (count - 1), side = 25;
    masks.push_back(Sequence::mask_of(
        {{90.0 + k, 80.0}, side * std::sqrt(aspect), side / std::sqrt(aspect), 0.37 * k},
        {200, 170}));
  }
  return masks;
}

std::vector<FrontPoint> front_of(const Ellipse& e, int count, double noise_px, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal(0, noise_px);
  std::vector<FrontPoint> front;
  for (int k = 0; k < count; ++k) {
    const Eigen::Vector2d at = e.point(2 * std::numbers::pi * k / count);
    const double du = normal(random), dv = normal(random);
    front.push_back({static_cast<float>(at.x() + du), static_cast<float>(at.y() + dv), 0});
  }
  return front;
}

TEST(ShapeModel, finds_aspect_as_the_first_mode_of_ellipses) {
  const ShapeModel model = ShapeModel::train(masks_of(13));
  EXPECT_EQ(model.modes(), kMaxModes);
  double sum = 0;
  for (const double value : model.eigenvalues()) sum += value;
  // One number varies: the rest is what pixels make of a rim.
  EXPECT_GT(model.eigenvalues()[0] / (sum / model.explained()), 0.8);
}

TEST(ShapeModel, fits_pose_and_aspect_to_a_noisy_front) {
  const ShapeModel model = ShapeModel::train(masks_of(13));
  for (unsigned seed = 1; seed <= 10; ++seed) {
    const double aspect = 1.6 + 0.08 * seed;
    const Ellipse truth{{100.5, 61.2}, 22 * std::sqrt(aspect), 22 / std::sqrt(aspect), 0.1 * seed};
    ShapePose start = model.pose_of(truth);
    start.center_px += Eigen::Vector2d(2, -2);
    start.angle += 0.08;
    start.scale_px *= 1.04;
    const Ellipse found = model.ellipse_of(model.fit(front_of(truth, 120, 0.4, seed), start, {}));
    // px: 0.4 px of noise over 120 points is 0.05; the masks' pixels and the pull of the start are
    // the rest.
    EXPECT_LT((found.center_px - truth.center_px).norm(), 0.4);
    EXPECT_NEAR(found.semi_major_px, truth.semi_major_px, 0.8);
    EXPECT_NEAR(found.semi_minor_px, truth.semi_minor_px, 0.8);
    EXPECT_NEAR(std::remainder(found.angle - truth.angle, std::numbers::pi), 0, 0.03);
  }
}

TEST(ShapeModel, completes_a_front_that_is_hidden_over_two_fifths) {
  const ShapeModel model = ShapeModel::train(masks_of(13));
  const Ellipse truth{{100, 60}, 31, 15.5, 0.3};
  auto front = front_of(truth, 120, 0.3, 5);
  for (std::size_t k = 0; k < 48; ++k)
    front[k].v += 25;  // the front fled along whatever hides the object
  const ShapeFit fit = model.fit(front, model.pose_of(truth), {});
  const Ellipse found = model.ellipse_of(fit);
  EXPECT_LT((found.center_px - truth.center_px).norm(),
            1);  // px: Tukey's weights forget what is 2.5 px off
  EXPECT_LT(fit.inlier_fraction, 0.8);
}

TEST(ShapeModel, is_a_signed_distance_in_pixels_once_placed) {
  const ShapeModel model = ShapeModel::train(masks_of(13));
  ShapeFit fit;
  fit.pose = {{100, 60}, 0.3, 22};
  const PlacedShape placed(model, fit);
  const Ellipse rim = model.ellipse_of(fit);
  const Eigen::Vector2d along(std::cos(rim.angle), std::sin(rim.angle));
  for (const double beyond : {-4.0, 0.0, 6.0}) {
    const Eigen::Vector2d at = rim.center_px + (rim.semi_major_px + beyond) * along;
    EXPECT_NEAR(placed.at(at.x(), at.y()), beyond,
                0.8);  // px: the mean of several tips is blunter than one
  }
}

TEST(ShapeModel, comes_back_from_its_bytes_and_refuses_damaged_ones) {
  const ShapeModel model = ShapeModel::train(masks_of(5));
  const std::string bytes = model.save();
  EXPECT_EQ(ShapeModel::load(bytes).save(), bytes);
  for (std::size_t k = 0; k < bytes.size(); k += 3001) {
    std::string damaged = bytes;
    damaged[k] = static_cast<char>(damaged[k] ^ 4);
    EXPECT_THROW(ShapeModel::load(damaged), std::invalid_argument) << k;
    EXPECT_THROW(ShapeModel::load(bytes.substr(0, k)), std::invalid_argument) << k;
  }
}

TEST(ShapeModel, learns_one_mask_without_modes_and_refuses_none_empty_or_full) {
  EXPECT_EQ(ShapeModel::train(std::vector{masks_of(2)[0]}).modes(), 0);
  EXPECT_THROW(ShapeModel::train({}), std::invalid_argument);
  EXPECT_THROW(ShapeModel::train(std::vector{cv::Mat(cv::Mat::zeros(50, 50, CV_8UC1))}),
               std::invalid_argument);
  EXPECT_THROW(ShapeModel::train(std::vector{cv::Mat(50, 50, CV_8UC1, cv::Scalar(255))}),
               std::invalid_argument);
  EXPECT_THROW(ShapeModel::train(std::vector{cv::Mat(50, 50, CV_8UC3, cv::Scalar(255))}),
               std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
