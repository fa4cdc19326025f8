// View watch: a camera that was moved, or whose light changed, is told from one that sees a robot.
// SPDX-License-Identifier: Apache-2.0
#include "host/servo/view_watch.h"

#include <Eigen/Dense>
#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

namespace vitreo {
namespace VITREO_TEST_FILE {

/// Vessels on a bright ground, with noise of its own each time.
cv::Mat scene(std::uint64_t number, const cv::Point2d& shift = {0, 0}) {
  cv::Mat picture(240, 320, CV_8UC1, cv::Scalar(150));
  for (int k = 0; k < 7; ++k)
    cv::line(picture, cv::Point(20 + 45 * k, 0), cv::Point(5 + 40 * k, 239), cv::Scalar(90), 6);
  cv::line(picture, cv::Point(0, 60), cv::Point(319, 130), cv::Scalar(100), 6);
  cv::GaussianBlur(picture, picture, {0, 0}, 3);
  cv::Mat moved;
  const cv::Mat motion = (cv::Mat_<double>(2, 3) << 1, 0, shift.x, 0, 1, shift.y);
  cv::warpAffine(picture, moved, motion, picture.size(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  cv::Mat noise(picture.size(), CV_16SC1);
  cv::RNG random(number);
  random.fill(noise, cv::RNG::NORMAL, 0, 2);
  cv::add(moved, noise, moved, cv::noArray(), CV_8UC1);
  return moved;
}

struct ViewWatchTest : testing::Test {
  ViewWatch watch = [] {
    vision::Background background;
    for (std::uint64_t k = 0; k < 10; ++k) background.learn(scene(k + 1));
    return ViewWatch(background);
  }();
};

TEST_F(ViewWatchTest, SeesTheSceneWithARobotAndASpeckInIt) {
  for (std::uint64_t k = 100; k < 130; ++k) {
    cv::Mat picture = scene(k);
    cv::ellipse(picture, cv::Point(40 + static_cast<int>(k), 100), {30, 14}, 20, 0, 360,
                cv::Scalar(20), cv::FILLED);
    cv::circle(picture, {200, 180}, 25, cv::Scalar(30), cv::FILLED);
    EXPECT_EQ(watch.fault(picture), "");
  }
}

TEST_F(ViewWatchTest, FindsTheShiftOfACameraThatWasKnocked) {
  const ViewChange change = watch.look(scene(7, {1.2, -0.8}));
  EXPECT_NEAR(change.shift_px.x, 1.2, 0.3);
  EXPECT_NEAR(change.shift_px.y, -0.8, 0.3);
  EXPECT_NE(watch.fault(scene(8, {3, 0})), "");
  EXPECT_NE(watch.fault(scene(9, {0, -20})), "");
}

TEST_F(ViewWatchTest, TellsAPictureThatIsMirroredTurnedOrOfOtherLight) {
  cv::Mat mirrored, turned, bright;
  cv::flip(scene(11), mirrored, 1);
  cv::rotate(scene(12), turned, cv::ROTATE_180);
  scene(13).convertTo(bright, -1, 1.4);
  for (const cv::Mat& picture : {mirrored, turned, bright}) EXPECT_NE(watch.fault(picture), "");
}

/// A small scene, so that each of its inner pixels is looked at.
vision::Background small_scene() {
  vision::Background background;
  for (std::uint64_t k = 0; k < 10; ++k)
    background.learn(scene(k + 1)(cv::Rect(40, 50, 40, 30)).clone());
  return background;
}

// Weighted least squares, solved by another hand's matrix: w g g' s = - w g (seen - level).
TEST_F(ViewWatchTest, TheShiftIsTheLeastSquaresSolutionOfWhatIsTheScene) {
  const vision::Background background = small_scene();
  const cv::Mat seen = scene(50, {0.4, -0.3})(cv::Rect(40, 50, 40, 30)).clone();
  Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
  Eigen::Vector2d right = Eigen::Vector2d::Zero();
  int others = 0;
  for (int v = 1; v < 29; ++v)
    for (int u = 1; u < 39; ++u) {
      const auto at = [&](int row, int column) -> double {
        return background.mean().at<float>(row, column);
      };
      const Eigen::Vector2d g((at(v, u + 1) - at(v, u - 1)) / 2, (at(v + 1, u) - at(v - 1, u)) / 2);
      const cv::Mat& noise = background.noise_of_level();
      const int bin = std::clamp(static_cast<int>(std::lround(at(v, u))), 0, noise.cols - 1);
      const double sigma = std::max(0.3, static_cast<double>(noise.at<float>(0, bin)));
      const double apart = seen.at<unsigned char>(v, u) - at(v, u);
      if (std::abs(apart) > std::max(6 * sigma, 8.0) + 2 * g.lpNorm<1>()) {
        ++others;
        continue;
      }
      normal += g * g.transpose() / (sigma * sigma);
      right -= g * apart / (sigma * sigma);
    }
  const Eigen::Vector2d shift = normal.ldlt().solve(right);
  const Eigen::Matrix2d covariance = normal.inverse();
  const ViewChange found = ViewWatch(background).look(seen);
  EXPECT_NEAR(found.shift_px.x, shift.x(), 1e-5);
  EXPECT_NEAR(found.shift_px.y, shift.y(), 1e-5);
  const double sigma = std::sqrt(covariance.diagonal().maxCoeff());
  EXPECT_NEAR(found.shift_sigma_px, sigma, 1e-5 * sigma);
  EXPECT_NEAR(found.changed, others / (28.0 * 38.0), 1e-12);
}

TEST_F(ViewWatchTest, CountsEachPixelThatIsAnother) {
  const ViewWatch small(small_scene());
  cv::Mat seen;
  small_scene().mean().convertTo(seen, CV_8UC1);
  EXPECT_EQ(small.look(seen).changed, 0);
  seen(cv::Rect(1, 1, 5, 4)).setTo(0);
  EXPECT_NEAR(small.look(seen).changed, 20 / (28.0 * 38.0), 1e-12);
  seen.setTo(0);
  EXPECT_EQ(small.look(seen).changed, 1);
  EXPECT_EQ(small.fault(seen).find("100 % of its picture is not the empty scene"), 0U);
  // Every second pixel of the large one, and not those between them.
  cv::Mat large;
  vision::Background background;
  for (std::uint64_t k = 0; k < 10; ++k) background.learn(scene(k + 1));
  background.mean().convertTo(large, CV_8UC1);
  large.at<unsigned char>(101, 101) = 0;
  EXPECT_EQ(watch.look(large).changed, 0);
  large.at<unsigned char>(100, 100) = 0;
  EXPECT_GT(watch.look(large).changed, 0);
}

// What slope so few pixels seem to have is left of the noise, and so is the shift.
TEST_F(ViewWatchTest, AShiftThatNoiseCouldMakeIsNone) {
  const auto faint = [](std::uint64_t number, double shift) {
    cv::Mat picture(14, 16, CV_8UC1), noise(14, 16, CV_16SC1);
    for (int v = 0; v < 14; ++v)
      for (int u = 0; u < 16; ++u)
        picture.at<unsigned char>(v, u) = cv::saturate_cast<unsigned char>(
            120 + 0.5 * std::sin(0.3 * (u - shift)) + 0.5 * std::cos(0.3 * v));
    cv::RNG random(number);
    random.fill(noise, cv::RNG::NORMAL, 0, 8);
    cv::add(picture, noise, picture, cv::noArray(), CV_8UC1);
    return picture;
  };
  vision::Background background;
  for (std::uint64_t k = 0; k < 200; ++k) background.learn(faint(k + 1, 0));
  const ViewWatch plain(background);
  int large = 0;
  for (std::uint64_t k = 0; k < 200; ++k) {
    const cv::Mat seen = faint(1000 + k, 0);
    const ViewChange change = plain.look(seen);
    large += std::hypot(change.shift_px.x, change.shift_px.y) > 1.5 ? 1 : 0;
    EXPECT_EQ(plain.fault(seen), "") << k;
  }
  EXPECT_GT(large, 0) << "the scene is faint enough to tell";
}

TEST_F(ViewWatchTest, OfASceneWithoutStructureSaysNoShift) {
  vision::Background plain;
  for (int k = 0; k < 5; ++k) plain.learn(cv::Mat(100, 100, CV_8UC1, cv::Scalar(120 + k % 2)));
  EXPECT_EQ(ViewWatch(plain).fault(cv::Mat(100, 100, CV_8UC1, cv::Scalar(121))), "");
  EXPECT_EQ(ViewWatch(plain).look(cv::Mat(100, 100, CV_8UC1, cv::Scalar(121))).shift_sigma_px, 1e9);
  // Stripes aslant show a shift across them and none along: not both.
  vision::Background stripes;
  cv::Mat aslant(50, 60, CV_8UC1);
  for (int v = 0; v < 50; ++v)
    for (int u = 0; u < 60; ++u)
      aslant.at<unsigned char>(v, u) = static_cast<unsigned char>(100 + 5 * ((u + v) % 20));
  for (int k = 0; k < 5; ++k) stripes.learn(aslant);
  EXPECT_EQ(ViewWatch(stripes).look(aslant).shift_sigma_px, 1e9);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
