// SPDX-License-Identifier: Apache-2.0
#include "vision/blob_tracker.h"

#include "tests/vision/synthetic.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <stdexcept>
#include <vector>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

using namespace synthetic;

BlobTrackerSettings settings_for(const Bench& bench) {
  BlobTrackerSettings s;
  s.blur_sigma_px = bench.scene.blur_sigma_px;
  return s;
}

TEST(BlobTracker, states_about_the_scatter_it_has_on_a_body_at_rest) {
  Bench bench;
  BlobTracker tracker(bench.background, settings_for(bench));
  const Ellipse truth{{300.3, 200.7}, 70, 35, 0.4};
  cv::Mat mean = bench.ground.clone();
  draw_body(mean, truth, metal(), bench.scene);
  Eigen::Matrix<double, 5, 1> sum = Eigen::Matrix<double, 5, 1>::Zero(), squares = sum, said = sum;
  const int images = 150;
  for (int k = 0; k < images; ++k) {
    const auto found = tracker.update(noisy(mean, bench.scene, bench.random));
    ASSERT_TRUE(found);
    const Eigen::Matrix<double, 5, 1> off = found->ellipse.vector() - truth.vector();
    sum += off / images;
    squares += off.cwiseAbs2() / images;
    said += found->covariance.diagonal() / images;
  }
  for (int k = 0; k < 5; ++k) {
    const double ratio = std::sqrt(said[k] / (squares[k] - sum[k] * sum[k]));
    EXPECT_GT(ratio, 0.7) << k;  // never much too sure
    EXPECT_LT(ratio, 6)
        << k;  // its floors stand for what noise does not show: 0.02 px all round, 0.05 px a normal
  }
}

// The points are where the rim is, whatever the ellipse makes of them: a median of 0.05 px, the
// floor of a normal, and none off by more than what its curvature leaves at the sharp ends.
TEST(BlobTracker, gives_the_points_of_the_rim_that_its_ellipse_was_fitted_to) {
  Bench bench;
  BlobTracker tracker(bench.background, settings_for(bench));
  const Ellipse truth{{300.3, 200.7}, 70, 35, 0.4};
  const auto found = tracker.update(bench.image(truth, metal()));
  ASSERT_TRUE(found);
  ASSERT_GT(found->contour.size(), 55u);  // of 64 normals
  const Eigen::Matrix2d to_circle = truth.shape().inverse();
  std::vector<double> off;
  double turned = 0;
  Eigen::Vector2d before = found->contour.back().point_px - truth.center_px;
  for (const ContourPoint& point : found->contour) {
    const Eigen::Vector2d from = point.point_px - truth.center_px;
    const Eigen::Vector2d gradient = to_circle * to_circle * from;
    const double radius = (to_circle * from).norm();
    off.push_back(std::abs(radius - 1) * radius / gradient.norm());  // px, first order
    EXPECT_GT(point.outward.dot(gradient.normalized()), 0.99);
    EXPECT_GT(point.variance, 0);
    turned += std::atan2(before.x() * from.y() - before.y() * from.x(), before.dot(from));
    before = from;
  }
  EXPECT_NEAR(std::abs(turned), 2 * std::numbers::pi, 1e-9) << "in order, once round";
  std::sort(off.begin(), off.end());
  EXPECT_LT(off[off.size() / 2], 0.1);
  EXPECT_LT(off.back(), 0.6);
}

/// A box with flat ends, as a cylinder shows, into `image`: covered by both pairs of sides, each
/// blurred by the scene's blur. Half sizes along and across, px.
void draw_box(cv::Mat& image, const Ellipse& box, double gray, const Scene& scene) {
  const auto inside = [&](double x, double half) {
    const double root = std::sqrt(2.0) * scene.blur_sigma_px;
    return (std::erf((x + half) / root) - std::erf((x - half) / root)) / 2;
  };
  const double c = std::cos(box.angle), s = std::sin(box.angle);
  for (int v = 0; v < image.rows; ++v)
    for (int u = 0; u < image.cols; ++u) {
      const double x = u - box.center_px.x(), y = v - box.center_px.y();
      const double cover =
          inside(c * x + s * y, box.semi_major_px) * inside(-s * x + c * y, box.semi_minor_px);
      float& pixel = image.at<float>(v, u);
      pixel += static_cast<float>(cover * (gray - pixel));
    }
}

// At a corner the rim lies five pixels outside of the ellipse through it, and its blur ends five
// farther out: searched over eight px, five to ten normals came and went from frame to frame, and
// the length with them, by 0.8 px, which a loop took for 0.3 mm of depth.
TEST(BlobTracker, finds_all_of_a_rim_with_corners_in_every_frame) {
  Bench bench;
  BlobTrackerSettings settings = settings_for(bench);
  settings.corners = true;
  for (const double half : {15.0, 32.0, 60.0}) {
    BlobTracker tracker(bench.background, settings);
    std::vector<double> lengths, widths;
    double stated = 0;
    for (int k = 0; k < 24; ++k) {
      const Ellipse box{{300.3 + 0.27 * k, 200.7 + 0.19 * k}, half, half / 2, 0.3};
      cv::Mat mean = bench.ground.clone();
      draw_box(mean, box, 40, bench.scene);
      const auto found = tracker.update(noisy(mean, bench.scene, bench.random));
      ASSERT_TRUE(found) << half << " " << k;
      EXPECT_EQ(found->inlier_fraction, 1) << half << " " << k;
      lengths.push_back(found->ellipse.semi_major_px);
      widths.push_back(found->ellipse.semi_minor_px);
      stated = std::sqrt(found->covariance(2, 2));
    }
    const auto [least, most] = std::minmax_element(lengths.begin(), lengths.end());
    EXPECT_LT(*most - *least, 0.35) << half;
    EXPECT_LT(*most - *least, 8 * stated) << half;
    const auto [narrow, wide] = std::minmax_element(widths.begin(), widths.end());
    EXPECT_LT(*wide - *narrow, 0.35) << half;
  }
}

TEST(BlobTracker, never_absorbs_a_body_that_holds_still) {
  Scene scene;
  scene.size = {320, 240};
  Bench bench(scene);
  BlobTracker tracker(bench.background, settings_for(bench));
  const Ellipse truth{{150, 110}, 50, 25, -0.7};
  cv::Mat mean = bench.ground.clone();
  draw_body(mean, truth, metal(), scene);
  std::optional<EllipseMeasurement> first, last;
  for (int k = 0; k < 300; ++k) {
    last = tracker.update(noisy(mean, scene, bench.random));
    ASSERT_TRUE(last) << k;
    if (!first) first = last;
  }
  EXPECT_LT((last->ellipse.vector() - first->ellipse.vector()).norm(),
            0.2);  // noise only: 0.02 px each, five and ten of it
}

TEST(BlobTracker, follows_a_body_that_moves_turns_and_jumps) {
  Bench bench;
  BlobTracker tracker(bench.background, settings_for(bench));
  for (int k = 0; k < 40; ++k) {
    Ellipse truth{{100 + 9.0 * k, 200 + 80 * std::sin(0.2 * k)}, 40, 20, 0.04 * k};
    if (k == 30) truth.center_px = {60, 60};
    const auto found = tracker.update(bench.image(truth, metal()));
    ASSERT_TRUE(found) << k;
    EXPECT_LT((found->ellipse.center_px - truth.center_px).norm(), 0.3)
        << k;  // several times the bias of this look
    EXPECT_GT(found->inlier_fraction, 0.8) << k;
  }
}

TEST(BlobTracker, measures_the_same_whatever_it_saw_before) {
  Bench bench;
  const Ellipse truth{{300, 200}, 70, 35, 0.4};
  const cv::Mat image = bench.image(truth, metal());
  BlobTracker fresh(bench.background, settings_for(bench)),
      used(bench.background, settings_for(bench));
  used.update(bench.image({{310, 195}, 70, 35, 0.5}, metal()));
  const auto a = fresh.update(image), b = used.update(image), c = fresh.update(image);
  ASSERT_TRUE(a && b && c);
  EXPECT_LT((a->ellipse.vector() - b->ellipse.vector()).norm(),
            0.05);  // they start from other grids: what rounds leave
  EXPECT_LT((c->ellipse.vector() - a->ellipse.vector()).norm(), 0.05);
  BlobTracker twin(bench.background, settings_for(bench));
  EXPECT_EQ(twin.update(image)->ellipse.vector(), a->ellipse.vector());  // same images, same bits
  EXPECT_EQ(twin.update(image)->ellipse.vector(), c->ellipse.vector());
}

TEST(BlobTracker, gives_nothing_on_the_empty_scene_a_blank_or_a_blinded_image) {
  Bench bench;
  BlobTracker tracker(bench.background, settings_for(bench));
  for (int k = 0; k < 20; ++k)
    EXPECT_FALSE(tracker.update(noisy(bench.ground, bench.scene, bench.random)));
  EXPECT_FALSE(tracker.update(cv::Mat::zeros(bench.scene.size, CV_8U)));
  EXPECT_FALSE(tracker.update(cv::Mat(bench.scene.size, CV_8U, cv::Scalar(255))));
  EXPECT_TRUE(tracker.update(bench.image({{300, 200}, 70, 35, 0.4}, metal())));
  EXPECT_FALSE(tracker.update(cv::Mat::zeros(bench.scene.size, CV_8U)));
  EXPECT_FALSE(tracker.update(noisy(bench.ground, bench.scene, bench.random)));
  EXPECT_TRUE(tracker.update(
      bench.image({{100, 300}, 70, 35, 0.4}, metal())));  // and finds it again at once
}

/// A dark disc with a soft edge, over whatever is there.
void darken(cv::Mat& mean, const Eigen::Vector2d& center, double radius_px) {
  for (int v = 0; v < mean.rows; ++v)
    for (int u = 0; u < mean.cols; ++u)
      mean.at<float>(v, u) *= static_cast<float>(
          1 -
          0.8 * std::clamp(radius_px + 0.5 - std::hypot(u - center.x(), v - center.y()), 0.0, 1.0));
}

TEST(BlobTracker, keeps_to_its_body_while_a_speck_drifts_across_it) {
  Bench bench;
  const Ellipse truth{{320, 240}, 70, 35, 0.1};
  for (const double radius_px : {10.0, 20.0, 40.0}) {
    BlobTracker tracker(bench.background, settings_for(bench));
    int seen = 0, looks = 0;
    double worst = 0;
    for (double u = 200; u < 440; u += 6, ++looks) {
      cv::Mat mean = bench.ground.clone();
      draw_body(mean, truth, metal(), bench.scene);
      darken(mean, {u, 242}, radius_px);
      const auto found = tracker.update(noisy(mean, bench.scene, bench.random));
      if (!found || found->inlier_fraction < 0.6)
        continue;  // who says that half of the rim is wrong is believed
      ++seen;
      const Eigen::Matrix<double, 5, 1> off = found->ellipse.vector() - truth.vector();
      worst = std::max(worst, off.head<4>().cwiseAbs().maxCoeff());
    }
    // Without a start from where it was due: 25 px off, with seven tenths of the rim in line.
    EXPECT_LT(worst, 2) << radius_px << ": px, of the normals at the speck's own edge";
    EXPECT_GT(seen, looks / 2) << radius_px;
  }
}

TEST(BlobTracker, is_not_fooled_by_a_bar_across_the_body) {
  Bench bench;
  BlobTracker tracker(bench.background, settings_for(bench));
  const Ellipse truth{{300, 200}, 70, 35, 0.4};
  ASSERT_TRUE(tracker.update(bench.image(truth, metal())));
  for (const int width : {20, 60, 120}) {
    cv::Mat image = bench.image(truth, metal());
    cv::line(image, {330, 0}, {340, 479}, 40, width);
    const auto found = tracker.update(image);
    if (!found) continue;
    const bool right = (found->ellipse.vector() - truth.vector()).head<4>().norm() < 5;
    EXPECT_TRUE(right || found->inlier_fraction < 0.8) << width;
  }
}

TEST(BlobTracker, keeps_measuring_beside_the_images_edge_or_gives_up) {
  Bench bench;
  BlobTracker tracker(bench.background, settings_for(bench));
  for (double u = 80; u > -60; u -= 10) {
    const Ellipse truth{{u, 240}, 60, 30, 0};
    const auto found = tracker.update(bench.image(truth, metal()));
    if (u > 75) {
      ASSERT_TRUE(found);
    }
    if (!found) continue;
    EXPECT_TRUE(found->ellipse.vector().allFinite() && found->covariance.allFinite());
    if (found->inlier_fraction > 0.8) {
      EXPECT_LT((found->ellipse.center_px - truth.center_px).norm(), 0.5);
    }
  }
  EXPECT_FALSE(tracker.update(bench.image({{-90, 240}, 60, 30, 0}, metal())));
}

TEST(BlobTracker, sees_through_a_lamp_that_flickers) {
  Bench bench;
  BlobTracker tracker(bench.background, settings_for(bench));
  const Ellipse truth{{300, 200}, 70, 35, 0.4};
  cv::Mat mean = bench.ground.clone();
  draw_body(mean, truth, metal(), bench.scene);
  for (const double lamp : {0.98, 1.02}) {
    const auto found = tracker.update(noisy(mean * lamp, bench.scene, bench.random));
    ASSERT_TRUE(found);
    EXPECT_LT(2 * std::abs(found->ellipse.semi_minor_px - truth.semi_minor_px),
              0.5);  // the figure
    EXPECT_LT(2 * std::abs(found->ellipse.semi_major_px - truth.semi_major_px), 0.5);
  }
}

TEST(BlobTracker, stays_free_of_nan_on_random_scribble) {
  Bench bench;
  BlobTracker tracker(bench.background, settings_for(bench));
  std::uniform_int_distribution<int> u(-100, 740), v(-100, 580), gray(0, 255), size(1, 150),
      turn(0, 360);
  for (int k = 0; k < 150; ++k) {
    cv::Mat image = noisy(bench.ground, bench.scene, bench.random);
    for (int shapes = 0; shapes < 4; ++shapes) {
      const cv::Point at(u(bench.random), v(bench.random)), other(u(bench.random), v(bench.random));
      const cv::Size axes(size(bench.random), size(bench.random));
      const int level = gray(bench.random), angle = turn(bench.random);
      if (shapes % 2 == 0) {
        cv::ellipse(image, at, axes, angle, 0, 360, level, -1);
      } else {
        cv::line(image, at, other, level, 1 + angle / 20);
      }
    }
    const auto found = tracker.update(image);
    if (!found) continue;
    ASSERT_TRUE(found->ellipse.vector().allFinite());
    ASSERT_TRUE(found->covariance.allFinite());
    EXPECT_GE(found->ellipse.semi_minor_px, settings_for(bench).min_semi_minor_px);
    EXPECT_LE(found->ellipse.semi_major_px, settings_for(bench).max_semi_major_px);
    EXPECT_GE(found->inlier_fraction, 0.3);
  }
}

TEST(BlobTracker, refuses_images_and_settings_that_cannot_be) {
  Scene scene;
  scene.size = {160, 120};
  Bench bench(scene);
  BlobTracker tracker(bench.background, {});
  EXPECT_THROW(tracker.update(cv::Mat::zeros(120, 161, CV_8U)), std::invalid_argument);
  EXPECT_THROW(tracker.update(cv::Mat::zeros(120, 160, CV_16U)), std::invalid_argument);
  EXPECT_THROW(tracker.update(cv::Mat()), std::invalid_argument);
  EXPECT_THROW(BlobTracker({}, {}), std::invalid_argument);
  const auto refused = [&](auto change) {
    BlobTrackerSettings s;
    change(s);
    EXPECT_THROW(BlobTracker(bench.background, s), std::invalid_argument);
  };
  refused([](BlobTrackerSettings& s) { s.min_semi_minor_px = 0; });
  refused([](BlobTrackerSettings& s) { s.max_semi_major_px = 1; });
  refused(
      [](BlobTrackerSettings& s) { s.threshold_sigma = std::numeric_limits<double>::quiet_NaN(); });
  refused([](BlobTrackerSettings& s) { s.min_contrast = 0; });
  refused([](BlobTrackerSettings& s) { s.normals = 63; });
  refused([](BlobTrackerSettings& s) { s.search_px = 100; });
  refused([](BlobTrackerSettings& s) { s.blur_sigma_px = 0; });
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
