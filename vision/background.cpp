// SPDX-License-Identifier: Apache-2.0
#include "vision/background.h"

#include "vision/preconditions.h"

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

namespace vitreo::vision {
namespace {

constexpr int kGrayLevels = 256;
// Variance of a uniform distribution one gray level wide, that of rounding: no image has less
// noise.
constexpr double kRounding = 1.0 / 12;

// Noise variances summed by gray level, with the number of summands.
// Pooled by level instead of kept per pixel: a few images determine a curve over the levels well,
// and no single pixel's variance.
struct NoisePool {
  std::array<double, kGrayLevels> variance{};
  std::array<double, kGrayLevels> weight{};
  void add(double level, double value) {
    const auto bin = static_cast<std::size_t>(std::clamp(std::lround(level), 0L, kGrayLevels - 1L));
    variance[bin] += value;
    weight[bin] += 1;
  }
};

// The unbiased sample variance of each pixel over the images, (sum x^2 - (sum x)^2 / n) / (n - 1).
// Cancellation may leave less than nothing, hence the floor of 0.
NoisePool noise_over_images(const cv::Mat& sum, const cv::Mat& squares, int count) {
  NoisePool pool;
  for (int v = 0; v < sum.rows; ++v) {
    const float* s = sum.ptr<float>(v);
    const double* q = squares.ptr<double>(v);
    for (int u = 0; u < sum.cols; ++u) {
      const double total = s[u];
      pool.add(total / count, std::max((q[u] - total * total / count) / (count - 1), 0.0));
    }
  }
  return pool;
}

// From one image: neighbors along a row have nearly the same expectation, so half their squared
// difference, E (x - y)^2 / 2 = sigma^2, is noise. What texture adds errs on the side of too much.
// One image has no other measure of noise; a second one replaces this by the variance over time.
NoisePool noise_over_neighbors(const cv::Mat& image) {
  NoisePool pool;
  for (int v = 0; v < image.rows; ++v) {
    const float* row = image.ptr<float>(v);
    for (int u = 1; u < image.cols; ++u) {
      const double step = row[u] - row[u - 1];
      pool.add((row[u] + row[u - 1]) / 2, step * step / 2);
    }
  }
  return pool;
}

// Linear camera model (photon transfer, EMVA 1288): read noise is the same at all levels, the
// variance of shot noise grows with the level: variance = a + b level, both at least 0, by least
// squares over all pixels. The line also extends to levels that the empty scene lacks, as a
// robot's. Returns the standard deviations, one per gray level.
// Weighted by the number of pixels at each level.
cv::Mat fit_noise(const NoisePool& pool) {
  double n = 0;
  double x = 0;
  double y = 0;
  double xx = 0;
  double xy = 0;
  // Not the two levels at either end: there the sensor clips its own noise.
  for (std::size_t k = 2; k < kGrayLevels - 2; ++k) {
    const double w = pool.weight[k];
    const double level = static_cast<double>(k);
    n += w, x += w * level, xx += w * level * level;
    y += pool.variance[k], xy += level * pool.variance[k];
  }
  // slope = (n Sxy - Sx Sy) / (n Sxx - Sx^2), unless one level holds all pixels.
  const double spread = n * xx - x * x;
  double slope = spread > 1e-9 * n * n ? std::max((n * xy - x * y) / spread, 0.0) : 0;
  double start = n > 0 ? (y - slope * x) / n : kRounding;
  // A negative read variance is none: the line then goes through the origin and the mean.
  if (start < 0) {
    start = 0;
    slope = y / x;
  }
  cv::Mat noise(1, kGrayLevels, CV_32F);
  for (int k = 0; k < kGrayLevels; ++k) {
    noise.at<float>(k) = static_cast<float>(std::sqrt(std::max(start + slope * k, kRounding)));
  }
  return noise;
}

}  // namespace

// Drops the results computed from fewer images; mean and noise are made again when they are asked
// for.
void Background::learn(const cv::Mat& image) {
  require(!image.empty() && image.type() == CV_8UC1, "image: must be 8-bit gray");
  require(count_ == 0 || image.size() == sum_.size(), "image: its size differs from the first");
  if (count_ == 0) {
    // 32 bits hold the sum exactly up to 2^24 / 255 images; the squares need 64.
    sum_ = cv::Mat::zeros(image.size(), CV_32F);
    sum_of_squares_ = cv::Mat::zeros(image.size(), CV_64F);
  }
  cv::accumulate(image, sum_);
  cv::accumulateSquare(image, sum_of_squares_);
  ++count_;
  mean_.release();
  noise_.release();
}

const cv::Mat& Background::mean() const {
  if (count_ == 0) throw std::logic_error("the background has not been learnt yet");
  if (mean_.empty()) sum_.convertTo(mean_, CV_32F, 1.0 / count_);
  return mean_;
}

// Computed on demand and kept; not safe from two threads at once.
const cv::Mat& Background::noise_of_level() const {
  mean();  // throws before the first image, and fills mean_
  if (noise_.empty()) {
    noise_ = fit_noise(count_ > 1 ? noise_over_images(sum_, sum_of_squares_, count_)
                                  : noise_over_neighbors(mean_));
  }
  return noise_;
}

}  // namespace vitreo::vision
