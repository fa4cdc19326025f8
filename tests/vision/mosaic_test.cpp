// SPDX-License-Identifier: Apache-2.0
#include "vision/mosaic.h"

#include "tests/vision/retina.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <iostream>
#include <stdexcept>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

struct Session {
  cv::Mat picture = synthetic::retina({1600, 1300}, 21);
  std::vector<cv::Mat> views;
  std::vector<Eigen::Affine2d> picture_from_view;
  std::mt19937_64 random{8};

  void look(const Eigen::Vector2d& at, double angle, double light = 1) {
    synthetic::ViewLook look;
    look.light = light;
    picture_from_view.push_back(synthetic::picture_from_view(at, angle));
    views.push_back(synthetic::view_of(picture, picture_from_view.back(), look, random));
  }
  /// To and fro in rows, with a turn of up to 12.5 degrees either way, so up to 25 between two
  /// views.
  void scan(int rows, int columns) {
    std::uniform_real_distribution<double> unit(-1, 1);
    for (int k = 0; k < rows * columns; ++k) {
      const int row = k / columns, column = row % 2 == 0 ? k % columns : columns - 1 - k % columns;
      const double u = unit(random), v = unit(random), turn = unit(random), light = unit(random);
      look({430 + 230 * column + 40 * u, 400 + 230 * row + 40 * v},
           12.5 * std::numbers::pi / 180 * turn, 1 + 0.1 * light);
    }
  }
  // Of all points of all views, in the frame of the first.
  double error_px(const MosaicPlan& plan) const {
    double sum = 0;
    int count = 0;
    for (std::size_t k = 0; k < views.size(); ++k) {
      if (!plan.mosaic_from_view[k]) continue;
      const Eigen::Affine2d truth = picture_from_view[0].inverse() * picture_from_view[k];
      for (int v = 0; v < 480; v += 40) {
        for (int u = 0; u < 640; u += 40, ++count)
          sum += (truth * Eigen::Vector2d(u, v) - *plan.mosaic_from_view[k] * Eigen::Vector2d(u, v))
                     .squaredNorm();
      }
    }
    return std::sqrt(sum / count);
  }
};

TEST(Mosaic, places_every_view_within_three_tenths_of_a_pixel) {
  Session session;
  session.scan(3, 4);
  const MosaicPlan plan = plan_mosaic(session.views);
  const double error = session.error_px(plan);
  std::cout << "mosaic of 12 views: rms " << error << " px from the truth; links "
            << plan.links.size() << ", spare " << plan.spare_links << ", rms " << plan.rms_px
            << " px, worst " << plan.worst_px << " px\n";
  EXPECT_EQ(plan.joined(), 12);
  EXPECT_LE(error, 0.3);  // the issue's
  EXPECT_GE(plan.spare_links, 5);
  EXPECT_GT(plan.rms_px, 0);
  EXPECT_LT(plan.rms_px, 0.1);  // the links' own noise is some hundredths
  EXPECT_LT(plan.worst_px, 0.3);
}

// White reflexes and dark dirt, where the sensor has them in every view.
TEST(Mosaic, does_not_collapse_on_what_is_fixed_to_the_sensor) {
  Session session;
  session.scan(2, 3);
  for (cv::Mat& view : session.views) {
    for (const cv::Point& at : {cv::Point(180, 150), {450, 120}, {330, 360}})
      cv::circle(view, at, 16, cv::Scalar::all(255), cv::FILLED, cv::LINE_AA);
    for (const cv::Point& at : {cv::Point(120, 300), {520, 330}, {270, 230}})
      cv::circle(view, at, 9, cv::Scalar::all(35), cv::FILLED, cv::LINE_AA);
  }
  const MosaicPlan plan = plan_mosaic(session.views);
  const double error = session.error_px(plan);
  std::cout << "fixed to the sensor: joined " << plan.joined() << " of 6, rms " << error
            << " px from the truth, reported " << plan.rms_px << " px\n";
  EXPECT_GE(plan.joined(), 5);
  EXPECT_LE(error, 1);
}

TEST(Mosaic, looks_like_the_retina_with_the_lamp_evened) {
  Session session;
  session.look({500, 500}, 0, 1);
  session.look({700, 520}, 0.2, 0.8);
  session.look({640, 700}, -0.1, 1.1);
  const MosaicPlan plan = plan_mosaic(session.views);
  ASSERT_EQ(plan.joined(), 3);
  const Mosaic mosaic = blend_mosaic(session.views, plan);
  // The lamp's strength is known up to a common factor.
  EXPECT_NEAR(mosaic.gains[1] / mosaic.gains[0], 1 / 0.8,
              0.05);  // the vignette, averaged over the overlap, remains
  EXPECT_NEAR(mosaic.gains[2] / mosaic.gains[0], 1 / 1.1, 0.05);
  // Small structure, which neither lamp nor vignette touch, against the picture's.
  Eigen::Matrix<double, 2, 3, Eigen::RowMajor> m =
      (session.picture_from_view[0] * mosaic.image_from_mosaic.inverse()).matrix().topRows<2>();
  cv::Mat truth, seen, wide;
  cv::warpAffine(session.picture, truth, cv::Mat(2, 3, CV_64F, m.data()), mosaic.image.size(),
                 cv::INTER_LINEAR | cv::WARP_INVERSE_MAP);
  mosaic.image.convertTo(seen, CV_32F);
  for (cv::Mat* image : {&truth, &seen}) {
    cv::GaussianBlur(*image, wide, {0, 0}, 10);
    *image -= wide;
  }
  cv::Mat inside;
  cv::erode(mosaic.cover, inside, cv::Mat::ones(61, 61, CV_8U), {-1, -1}, 1, cv::BORDER_CONSTANT,
            cv::Scalar(0));
  seen.setTo(0, ~inside), truth.setTo(0, ~inside);
  const double correlation = seen.dot(truth) / (cv::norm(seen) * cv::norm(truth));
  EXPECT_GT(correlation, 0.8);  // noise 4 against structure of about 8 gray levels
  EXPECT_EQ(mosaic.image.type(), CV_8U);
  EXPECT_EQ(cv::countNonZero(mosaic.image & ~mosaic.cover), 0);
}

TEST(Mosaic, leaves_out_by_name_what_does_not_belong) {
  Session session;
  session.look({500, 500}, 0);
  session.views.push_back(cv::Mat(480, 640, CV_8U, cv::Scalar(255)));  // dazzled
  session.picture_from_view.push_back(Eigen::Affine2d::Identity());
  session.look({650, 540}, 0.1);
  const MosaicPlan plan = plan_mosaic(session.views);
  EXPECT_TRUE(plan.mosaic_from_view[0] && plan.mosaic_from_view[2]);
  EXPECT_FALSE(plan.mosaic_from_view[1]);
  EXPECT_EQ(plan.joined(), 2);
  EXPECT_EQ(plan.spare_links, 0);  // and rms_px says nothing
  const Mosaic mosaic = blend_mosaic(session.views, plan);
  EXPECT_EQ(mosaic.gains[1], 1);
  double highest = 0;
  cv::minMaxLoc(mosaic.image, nullptr, &highest);
  EXPECT_LT(highest, 255);  // the dazzled view is not painted
}

TEST(Mosaic, of_color_is_in_color) {
  Session session;
  session.look({500, 500}, 0);
  session.look({650, 540}, 0.1);
  for (cv::Mat& view : session.views)
    cv::merge(std::vector<cv::Mat>{view / 4, view, view / 2}, view);
  const Mosaic mosaic = blend_mosaic(session.views, plan_mosaic(session.views));
  ASSERT_EQ(mosaic.image.type(), CV_8UC3);
  const cv::Scalar mean = cv::mean(mosaic.image, mosaic.cover);
  EXPECT_NEAR(mean[2] / mean[1], 0.5, 0.01);  // whole gray levels
  EXPECT_NEAR(mean[0] / mean[1], 0.25, 0.01);
}

TEST(Mosaic, of_nothing_in_common_joins_nothing) {
  const std::vector<cv::Mat> blank(3, cv::Mat(480, 640, CV_8U, cv::Scalar(40)));
  const MosaicPlan plan = plan_mosaic(blank);
  EXPECT_EQ(plan.joined(), 0);
  EXPECT_TRUE(plan.links.empty());
  EXPECT_THROW(blend_mosaic(blank, plan), std::invalid_argument);
}

TEST(Mosaic, refuses_views_and_settings_that_make_no_sense) {
  Session session;
  session.look({500, 500}, 0);
  EXPECT_THROW(plan_mosaic(session.views), std::invalid_argument);
  session.look({650, 540}, 0.1);
  const MosaicPlan plan = plan_mosaic(session.views);
  MosaicSettings small;
  small.max_pixels = 1000;
  EXPECT_THROW(blend_mosaic(session.views, plan, small), std::length_error);
  std::vector<cv::Mat> views = session.views;
  views.push_back(views[0]);
  EXPECT_THROW(blend_mosaic(views, plan), std::invalid_argument);
  views[2] = views[2](cv::Rect(0, 0, 600, 480));
  EXPECT_THROW(plan_mosaic(views), std::invalid_argument);
  MosaicSettings bad;
  bad.link_overlap = 1;
  EXPECT_THROW(plan_mosaic(session.views, bad), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
