// Evidence of a gray camera: levels around the object against its own, and a tracker across a part
// of the ground that has the object's gray.
// SPDX-License-Identifier: Apache-2.0
#include "vision/gray_evidence.h"

#include "tests/vision/tracking_score.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <vector>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

using generated::Frame;
using generated::Score;
using generated::Sequence;
using generated::SequenceSettings;

cv::Mat without_color(const cv::Mat& image) {
  cv::Mat gray;
  cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
  cv::cvtColor(gray, gray, cv::COLOR_GRAY2BGR);
  return gray;
}

// A dark disc of the ground behind the robot, with soft edges, that keeps `keep` of the light.
struct Fovea {
  cv::Point2d center{320, 240};
  double radius = 60;
  double keep = 0.70;  // of a ground of about 110 gray levels; the robot's body is at 50 to 80
};

cv::Mat before_fovea(const Frame& frame, const Fovea& fovea) {
  cv::Mat covered = Sequence::mask_of(frame.truth, frame.image.size());
  covered.convertTo(covered, CV_32F, 1.0 / 255);
  cv::GaussianBlur(covered, covered, {0, 0}, 1.3);
  cv::Mat image = frame.image.clone();
  for (int v = 0; v < image.rows; ++v)
    for (int u = 0; u < image.cols; ++u) {
      const double away = std::hypot(u - fovea.center.x, v - fovea.center.y);
      const double dark = (1 - fovea.keep) / (1 + std::exp((away - fovea.radius) / 5));
      auto& at = image.at<cv::Vec3b>(v, u);
      for (int c = 0; c < 3; ++c)
        at[c] = cv::saturate_cast<unsigned char>(
            at[c] * (1 - dark * (1 - static_cast<double>(covered.at<float>(v, u)))));
    }
  return without_color(image);
}

// To and fro along u through the middle, 2 px a frame.
SequenceSettings across() {
  SequenceSettings settings{.seed = 7301};
  settings.path = [](int k) {
    const double u = 320 + 200 * std::sin(0.01 * k + (k >= 5000 ? 0.5 : -1.2));
    return Ellipse{{u, 240 + 25 * std::sin(0.013 * k)}, 30, 15, 0.4 * std::sin(0.02 * k)};
  };
  return settings;
}

std::vector<LabeledImage> training(Sequence& sequence, const Fovea& fovea) {
  std::vector<LabeledImage> images;
  for (int k = 0; k < 16; ++k) {
    const Frame frame = sequence.frame(5000 + 37 * k);
    images.push_back(
        {before_fovea(frame, fovea), Sequence::mask_of(frame.truth, frame.image.size())});
  }
  return images;
}

double f_at(const EvidenceSource& source, const cv::Mat& image, int u, int v) {
  std::int8_t value = 0;
  source.read(image, v, u, 1, 1, &value);
  return value / ColorModel::kScale;
}

TEST(GrayEvidence, a_level_is_the_objects_where_the_ground_around_it_has_it_not) {
  cv::Mat image(240, 320, CV_8UC3, cv::Scalar::all(140));
  image.colRange(200, 320).setTo(cv::Scalar::all(60));
  cv::Mat mask = cv::Mat::zeros(image.size(), CV_8UC1);
  cv::ellipse(mask, {70, 120}, {30, 15}, 0, 0, 360, 255, cv::FILLED);
  image.setTo(cv::Scalar::all(60), mask);
  cv::ellipse(image, {90, 120}, {5, 5}, 0, 0, 360, cv::Scalar::all(90), cv::FILLED);
  const std::vector<LabeledImage> images{{image, mask}};
  const GrayModel model = GrayModel::train(images);
  ASSERT_TRUE(model.known);
  GrayEvidence source(model);
  source.surround(image, {{70, 120}, 30, 15, 0}, {}, 0);
  const double alone = f_at(source, image, 60, 120);
  EXPECT_GT(alone, 1.0);
  EXPECT_LT(f_at(source, image, 150, 120), -1.0);
  source.surround(image, {{260, 120}, 30, 15, 0}, {}, 0);
  EXPECT_LT(f_at(source, image, 260, 120), alone - 0.5) << "both have it";
  EXPECT_GT(f_at(source, image, 90, 120), 1.0) << "a level that this ground does not have";
}

TEST(GrayEvidence, levels_are_those_of_the_training_in_another_light) {
  Sequence sequence(across());
  const auto images = training(sequence, {});
  const GrayModel model = GrayModel::train(images);
  GrayEvidence source(model);
  cv::Mat darker;
  images[3].image.convertTo(darker, -1, 0.5);
  const cv::Mat levels(1, 1, CV_8UC3, cv::Scalar::all(64));
  const cv::Mat half(1, 1, CV_8UC3, cv::Scalar::all(32));
  const double before = f_at(source, levels, 0, 0);
  source.set_light(LogColor::Constant(std::log(0.5)));
  EXPECT_NEAR(f_at(source, half, 0, 0), before, 0.2);
}

TEST(GrayEvidence, another_objects_pixels_are_no_ground) {
  cv::Mat image(240, 320, CV_8UC3, cv::Scalar::all(140));
  cv::Mat mask = cv::Mat::zeros(image.size(), CV_8UC1);
  cv::ellipse(mask, {160, 120}, {30, 15}, 0, 0, 360, 255, cv::FILLED);
  image.setTo(cv::Scalar::all(60), mask);
  const std::vector<LabeledImage> images{{image, mask}};
  const GrayModel model = GrayModel::train(images);
  cv::Mat owned = cv::Mat::zeros(image.size(), CV_8UC1);
  owned.rowRange(140, 240).setTo(2);
  image.setTo(cv::Scalar::all(60), owned);
  GrayEvidence source(model);
  source.surround(image, {{160, 120}, 30, 15, 0}, {}, 0);
  const double as_ground = f_at(source, image, 160, 120);
  source.surround(image, {{160, 120}, 30, 15, 0}, owned, 1);
  EXPECT_GT(f_at(source, image, 160, 120), as_ground + 1);
}

TEST(GrayEvidence, images_with_color_have_no_gray_model) {
  cv::Mat image(60, 60, CV_8UC3, cv::Scalar::all(140));
  image.at<cv::Vec3b>(30, 30) = {140, 140, 141};
  cv::Mat mask = cv::Mat::zeros(image.size(), CV_8UC1);
  mask(cv::Rect(20, 20, 12, 8)).setTo(255);
  const std::vector<LabeledImage> images{{image, mask}};
  EXPECT_FALSE(GrayModel::train(images).known);
}

TEST(GrayEvidence, a_robot_is_followed_across_a_ground_of_its_own_gray) {
  Sequence sequence(across());
  const Fovea fovea;
  const ObjectModel model = ObjectModel::train(training(sequence, fovea), {}, {});
  ASSERT_TRUE(model.gray.known);
  ColorTracker tracker(ObjectModel::load(model.save()), {});
  Score score;
  double worst = 0;
  for (int k = 0; k < 240; ++k) {
    const Frame frame = sequence.frame(k);
    const Track track = tracker.update(before_fovea(frame, fovea));
    if (!track.measured) {
      score.lost += k >= 3;
      continue;
    }
    add_errors(score, *track.measured, frame.truth);
    worst = std::max(worst, (track.measured->ellipse.center_px - frame.truth.center_px).norm());
  }
  std::printf("lost %d of 240, %.2f px, worst %.2f px, %.0f %% inside\n", score.lost,
              score.center_px / score.seen, worst, 100 * score.inside / score.seen);
  EXPECT_LE(score.lost, 8) << "56 while the ground was that of the training alone";
  EXPECT_LT(worst, 2.5);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
