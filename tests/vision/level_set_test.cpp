// SPDX-License-Identifier: Apache-2.0
#include "vision/level_set.h"

#include "vision/evidence.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <vector>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

constexpr int kObject = 60, kGround = 180, kBetween = 120;

// A model that knows two grays; what lies between it has never seen: F = 0.
const ColorModel& two_grays() {
  static const ColorModel model = [] {
    LabeledImage one{cv::Mat(60, 60, CV_8UC3, cv::Scalar::all(kGround)),
                     cv::Mat::zeros(60, 60, CV_8UC1)};
    cv::circle(one.mask, {30, 30}, 15, cv::Scalar(255), cv::FILLED);
    one.image.setTo(cv::Scalar::all(kObject), one.mask);
    return ColorModel::train(std::vector{one}, {});
  }();
  return model;
}

void draw(cv::Mat& image, const Ellipse& e, int gray) {
  for (int v = 0; v < image.rows; ++v) {
    const RowSpan span = row_of(e, v);
    for (int u = std::max(span.first, 0); u < std::min(span.end, image.cols); ++u) {
      image.at<cv::Vec3b>(v, u) = cv::Vec3b::all(static_cast<unsigned char>(gray));
    }
  }
}

cv::Mat ground() { return {200, 200, CV_8UC3, cv::Scalar::all(kGround)}; }

struct Evolved {
  Evidence evidence;
  LevelSet front;
  Segment segment;
  Evolved(const cv::Mat& image, const Ellipse& start, double gate_px,
          const LevelSetSettings& settings = {}, const Thresholds& thresholds = {-1, 1})
      : front(settings) {
    ColorEvidence colors(two_grays());
    evidence.look(image, colors, grown(start, gate_px), 400);
    front.start(evidence, start);
    front.evolve(thresholds);
    segment = front.keep_largest();
  }
};

TEST(LevelSet, grows_and_shrinks_onto_an_object_from_a_start_that_is_off) {
  const Ellipse truth{{100.3, 98.7}, 30, 15, 0.5};
  cv::Mat image = ground();
  draw(image, truth, kObject);
  for (const double by : {-8.0, 0.0, 8.0}) {
    Ellipse start = grown(truth, by);
    start.center_px += Eigen::Vector2d(3, -2);
    const Evolved run(image, start, 14);
    EXPECT_LT((run.segment.ellipse.center_px - truth.center_px).norm(),
              0.5);  // px: pixels count whole, and what is undecided stays
    EXPECT_NEAR(run.segment.ellipse.semi_major_px, truth.semi_major_px,
                0.8);  // cycle two rounds the tips off
    EXPECT_NEAR(run.segment.ellipse.semi_minor_px, truth.semi_minor_px, 0.8);
    EXPECT_NEAR(run.segment.ellipse.angle, truth.angle, 0.02);
    EXPECT_FALSE(run.front.leaked());
  }
}

TEST(LevelSet, keeps_phi_and_its_two_lists_as_the_definition_says) {
  cv::Mat image = ground();
  draw(image, {{100, 100}, 30, 15, 0.5}, kObject);
  Evolved run(image, {{102, 99}, 33, 13, 0.3}, 10);
  std::vector<FrontPoint> points;
  run.front.front(points);
  std::size_t in = 0, out = 0;
  const cv::Rect region = run.evidence.region();
  for (int v = region.y + 1; v < region.y + region.height - 1; ++v) {
    for (int u = region.x + 1; u < region.x + region.width - 1; ++u) {
      const int phi = run.front.phi(u, v);
      bool at_front = false;
      for (const auto& [du, dv] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
        at_front = at_front || run.front.phi(u + du, v + dv) * phi < 0;
      }
      ASSERT_EQ(phi == 1 || phi == -1, at_front) << u << ", " << v;
      in += phi == -1;
      out += phi == 1;
    }
  }
  EXPECT_EQ(points.size(), in + out);  // each once
  EXPECT_GT(in, 50U);
}

TEST(LevelSet, leaves_undecided_pixels_as_they_were) {
  // All of one gray that says nothing: the front stays where it started, between the two
  // thresholds.
  const cv::Mat image(200, 200, CV_8UC3, cv::Scalar::all(kBetween));
  const Ellipse start{{100, 100}, 30, 15, 0};
  const Evolved run(image, start, 12);
  EXPECT_NEAR(run.segment.ellipse.semi_major_px, 30, 0.8);
  EXPECT_NEAR(run.segment.ellipse.semi_minor_px, 15, 0.8);
}

TEST(LevelSet, never_leaves_the_gate_nor_the_image) {
  const cv::Mat image(200, 200, CV_8UC3,
                      cv::Scalar::all(kObject));  // nothing stops it but the gate
  for (const double u : {100.0, 2.0, 198.0, -300.0}) {
    const Ellipse start{{u, 100}, 30, 15, 0};
    const Evolved run(image, start, 9);
    EXPECT_LE(run.segment.ellipse.semi_major_px, 40);
    EXPECT_LE(run.segment.area_px, 3.15 * 39 * 24 + 100);
  }
}

TEST(LevelSet, stops_a_front_that_grows_longer_than_allowed) {
  cv::Mat image = ground();
  for (int u = 0; u < 200; u += 4) image.col(u).setTo(cv::Scalar::all(kObject));
  cv::Mat noise(200, 200, CV_8UC3);
  cv::RNG random(3);
  random.fill(noise, cv::RNG::UNIFORM, 0, 2);
  image.setTo(cv::Scalar::all(kObject), noise.reshape(1).colRange(0, 200) > 0);
  LevelSetSettings settings;
  settings.max_points = 300;
  const Evolved run(image, {{100, 100}, 80, 80, 0}, 10, settings);
  EXPECT_TRUE(run.front.leaked());
}

TEST(LevelSet, keeps_only_the_largest_part) {
  cv::Mat image = ground();
  draw(image, {{80, 100}, 20, 15, 0}, kObject);
  draw(image, {{125, 100}, 10, 8, 0}, kObject);
  const Evolved run(image, {{95, 100}, 45, 18, 0}, 10);
  EXPECT_NEAR(run.segment.ellipse.center_px.x(), 80, 0.5);
  EXPECT_GT(run.front.phi(125, 100), 0);
}

TEST(LevelSet, finds_nothing_where_nothing_is) {
  const Evolved run(ground(), {{100, 100}, 30, 15, 0}, 9);
  EXPECT_EQ(run.segment.area_px, 0);
}

TEST(CycleThree, pulls_the_front_to_the_shape_where_color_says_nothing) {
  std::vector<cv::Mat> masks;
  for (const double b : {14.0, 15.0, 16.0}) {
    cv::Mat mask = cv::Mat::zeros(120, 120, CV_8UC1);
    cv::ellipse(mask, {60, 60}, cv::Size(30, static_cast<int>(b)), 0, 0, 360, cv::Scalar(255),
                cv::FILLED);
    masks.push_back(mask);
  }
  const ShapeModel model = ShapeModel::train(masks);
  const Ellipse truth{{100, 100}, 30, 15, 0.4};
  cv::Mat image = ground();
  draw(image, truth, kObject);
  image.colRange(112, 130).setTo(cv::Scalar::all(kGround));  // hides one end of it
  const Ellipse start = grown(truth, 1);
  LevelSetSettings settings;
  settings.prior_iterations = 30;
  Evolved run(image, start, 9, settings);
  std::vector<FrontPoint> points;
  run.front.front(points);
  const ShapeFit fit = model.fit(points, model.pose_of(start), {});
  run.front.evolve_to_prior(PlacedShape(model, fit));
  const Segment after = run.front.keep_largest();
  EXPECT_LT(run.segment.area_px, 0.9 * 3.14 * 30 * 15);
  EXPECT_NEAR(after.area_px, 3.14 * 30 * 15,
              0.12 * 3.14 * 30 * 15);  // the bar's edges pull the fit a little
  EXPECT_LT((after.ellipse.center_px - truth.center_px).norm(), 3);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
