// SPDX-License-Identifier: Apache-2.0
#include "vision/focus.h"

#include "tests/vision/focus_stack.h"

#include <climits>
#include <gtest/gtest.h>

#include <limits>
#include <stdexcept>
#include <string>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

cv::Mat random_image(const cv::Size& size, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::uniform_int_distribution<int> level(0, 255);
  cv::Mat image(size, CV_8U);
  for (int v = 0; v < size.height; ++v) {
    for (int u = 0; u < size.width; ++u)
      image.at<unsigned char>(v, u) = static_cast<unsigned char>(level(random));
  }
  return image;
}

double tenengrad_by_hand(const cv::Mat& image, const cv::Rect& area, double sigma) {
  cv::Mat gray, gx, gy;
  image.convertTo(gray, CV_64F);
  // The binomial of five, as the measure has it: not quite a Gaussian of sigma 1.
  const cv::Mat binomial = (cv::Mat_<double>(5, 1) << 1, 4, 6, 4, 1) / 16;
  if (sigma > 0) cv::sepFilter2D(gray, gray, CV_64F, binomial, binomial);
  cv::Sobel(gray, gx, CV_64F, 1, 0);
  cv::Sobel(gray, gy, CV_64F, 0, 1);
  return cv::mean((gx.mul(gx) + gy.mul(gy))(area))[0];
}

TEST(FocusMeasure, is_found_by_each_of_its_names) {
  EXPECT_EQ(focus_measures().size(), 8U);
  for (const FocusMeasure measure : focus_measures())
    EXPECT_EQ(focus_measure(name_of(measure)), measure);
  try {
    focus_measure("sharpness");
    FAIL() << "an unknown name was accepted";
  } catch (const std::invalid_argument& e) {
    EXPECT_NE(std::string(e.what()).find("tenengrad"), std::string::npos)
        << e.what();  // says what there is
  }
}

TEST(FocusMeasure, agrees_with_its_formula) {
  const cv::Mat image = random_image({60, 50}, 1);
  const cv::Rect area(11, 9, 30, 25);
  cv::Scalar mean, sigma;
  cv::meanStdDev(image(area), mean, sigma);
  const double mu = mean[0], variance = sigma[0] * sigma[0];
  const auto value = [&](FocusMeasure measure) { return focus(image, area, measure).value; };
  const double rounding = 1e-9;  // relative, of sums of some thousand terms
  EXPECT_NEAR(value(FocusMeasure::normalized_variance), variance / mu, rounding * variance);
  EXPECT_NEAR(value(FocusMeasure::variance_over_mean_squared), variance / (mu * mu), rounding);
  const double tenengrad = tenengrad_by_hand(image, area, 0),
               smoothed = tenengrad_by_hand(image, area, 1);
  EXPECT_NEAR(value(FocusMeasure::tenengrad), tenengrad, rounding * tenengrad);
  // In units of 16/256, truncated: 1/16 of the smoothed gradient's unit in some hundred.
  EXPECT_NEAR(value(FocusMeasure::smoothed_tenengrad), 256 * smoothed / (mu * mu),
              1e-2 * 256 * smoothed / (mu * mu));
  double brenner = 0, vollath = 0;
  cv::Mat laplacian;
  cv::Laplacian(image, laplacian, CV_64F);
  cv::meanStdDev(laplacian(area), mean, sigma);
  for (int v = area.y; v < area.y + area.height; ++v) {
    const unsigned char* const row = image.ptr(v);
    for (int u = area.x; u < area.x + area.width; ++u) {
      brenner += (row[u + 2] - row[u]) * (row[u + 2] - row[u]);
      vollath += row[u] * row[u + 1] - row[u] * row[u + 2];
    }
  }
  EXPECT_NEAR(value(FocusMeasure::brenner), brenner / area.area(), rounding * brenner);
  EXPECT_NEAR(value(FocusMeasure::vollath4), vollath / area.area(), rounding * std::abs(vollath));
  EXPECT_NEAR(value(FocusMeasure::laplacian_variance), sigma[0] * sigma[0],
              rounding * sigma[0] * sigma[0]);
}

TEST(FocusMeasure, divided_by_the_squared_mean_does_not_see_the_lamp) {
  const cv::Mat dark = cv::min(random_image({64, 64}, 2) / 2, 127);
  const cv::Mat bright = 2 * dark;
  const cv::Rect all(0, 0, 64, 64);
  for (const FocusMeasure measure :
       {FocusMeasure::variance_over_mean_squared, FocusMeasure::smoothed_tenengrad}) {
    const double value = focus(dark, all, measure).value;
    EXPECT_NEAR(focus(bright, all, measure).value, value, 5e-3 * value)
        << name_of(measure);  // whole gray levels
  }
  const double thesis = focus(dark, all, FocusMeasure::normalized_variance).value;
  EXPECT_NEAR(focus(bright, all, FocusMeasure::normalized_variance).value, 2 * thesis,
              1e-6 * thesis);
}

TEST(FocusMeasure, is_nought_where_nothing_varies) {
  for (const int level : {0, 90, 255}) {
    const cv::Mat flat(40, 40, CV_8U, cv::Scalar(level));
    for (const FocusMeasure measure : focus_measures()) {
      const FocusReading reading = focus(flat, {0, 0, 40, 40}, measure);
      EXPECT_EQ(reading.value, 0) << name_of(measure) << " at " << level;
      EXPECT_EQ(reading.mean, level);
      EXPECT_EQ(reading.saturated, level == 255 ? 1 : 0);
    }
  }
}

TEST(FocusWindow, that_slides_reads_as_one_that_looks_anew) {
  const cv::Mat image = random_image({220, 180}, 3);
  for (const FocusMeasure measure : focus_measures()) {
    FocusWindow sliding(measure, {64, 48});
    FocusWindow fresh(measure, {64, 48}, 0);
    std::mt19937_64 random(4);
    std::uniform_int_distribution<int> step(-9, 9);
    cv::Point at(40, 40);
    sliding.look(image, at);
    for (int k = 0; k < 300; ++k) {  // over margins and borders, and back
      const int du = step(random), dv = step(random);
      at = {std::clamp(at.x + du, -10, 230), std::clamp(at.y + dv, -5, 185)};
      const FocusReading slid = sliding.move(at), looked = fresh.look(image, at);
      ASSERT_EQ(slid.value, looked.value)
          << name_of(measure) << " at " << at;  // integer sums: to the bit
      ASSERT_EQ(slid.mean, looked.mean);
      ASSERT_EQ(slid.pixels, looked.pixels);
      ASSERT_EQ(sliding.window_px(), fresh.window_px());
    }
  }
}

TEST(FocusWindow, is_cut_at_the_border_and_refused_outside) {
  const cv::Mat image = random_image({100, 80}, 5);
  FocusWindow window(kDefaultFocusMeasure, {32, 32});
  EXPECT_EQ(window.look(image, {50, 40}).pixels, 32 * 32);
  EXPECT_EQ(window.look(image, {0, 0}).pixels,
            13 * 13);  // half of 32, less the 3 that the measure needs around it
  const int far = 1 << 30;
  for (const cv::Point at :
       {cv::Point(-30, 40), cv::Point(50, 120), cv::Point(far, far), cv::Point(INT_MIN, INT_MAX)})
    EXPECT_THROW(window.look(image, at), std::invalid_argument) << at;
  EXPECT_THROW(window.move({10, 10}),
               std::logic_error);  // what a failed look leaves is not a window
  EXPECT_THROW(focus(image, {INT_MAX - 5, 0, INT_MAX, 10}), std::invalid_argument);
  EXPECT_THROW(focus(image, {10, 10, -5, 10}), std::invalid_argument);
  EXPECT_GT(focus(image, {-50, -50, INT_MAX, INT_MAX}).pixels, 0);
}

TEST(FocusWindow, refuses_what_it_cannot_measure_by_name) {
  FocusWindow window(kDefaultFocusMeasure, {32, 32});
  EXPECT_THROW(window.move({10, 10}), std::logic_error);
  EXPECT_THROW(window.look({}, {10, 10}), std::invalid_argument);
  cv::Mat not_a_number(50, 50, CV_32F, cv::Scalar(std::numeric_limits<float>::quiet_NaN()));
  EXPECT_THROW(window.look(not_a_number, {25, 25}), std::invalid_argument);
  EXPECT_THROW(window.look(cv::Mat(50, 50, CV_8UC3, cv::Scalar(1, 2, 3)), {25, 25}),
               std::invalid_argument);
  EXPECT_THROW(window.look(cv::Mat(6, 6, CV_8U, cv::Scalar(1)), {3, 3}),
               std::invalid_argument);  // all rim
  EXPECT_THROW(FocusWindow(kDefaultFocusMeasure, {3, 32}), std::invalid_argument);
  EXPECT_THROW(FocusWindow(kDefaultFocusMeasure, {32, 1 << 20}), std::invalid_argument);
  EXPECT_THROW(FocusWindow(kDefaultFocusMeasure, {32, 32}, -1), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
