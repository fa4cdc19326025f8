// SPDX-License-Identifier: Apache-2.0
#include "vision/background.h"

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

namespace vitreo::vision {
namespace {

constexpr int kLevels = 256;
constexpr double kRounding =
    1.0 / 12;  // variance of rounding to whole gray levels: no image has less noise

struct Pool {
  std::array<double, kLevels> variance{}, weight{};
  void add(double level, double value) {
    const auto bin = static_cast<std::size_t>(std::clamp(std::lround(level), 0L, kLevels - 1L));
    variance[bin] += value;
    weight[bin] += 1;
  }
};

// From the scatter of each pixel over the images.
Pool over_images(const cv::Mat& sum, const cv::Mat& squares, int count) {
  Pool pool;
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

// From one image: neighbors along a row see nearly the same thing, so half their squared difference
// is noise. What texture adds errs on the side of too much.
Pool over_neighbors(const cv::Mat& image) {
  Pool pool;
  for (int v = 0; v < image.rows; ++v) {
    const float* row = image.ptr<float>(v);
    for (int u = 1; u < image.cols; ++u) {
      const double step = row[u] - row[u - 1];
      pool.add((row[u] + row[u - 1]) / 2, step * step / 2);
    }
  }
  return pool;
}

// Read noise is the same at all levels, shot noise grows with the level: variance = a + b level,
// both at least 0. The line also speaks for levels that the empty scene does not show, as a
// robot's.
cv::Mat fitted(const Pool& pool) {
  double n = 0, x = 0, y = 0, xx = 0, xy = 0;
  for (std::size_t k = 2; k < kLevels - 2; ++k) {  // at the ends the sensor clips its own noise
    const double w = pool.weight[k], level = static_cast<double>(k);
    n += w, x += w * level, xx += w * level * level;
    y += pool.variance[k], xy += level * pool.variance[k];
  }
  const double spread = n * xx - x * x;
  double slope = spread > 1e-9 * n * n ? std::max((n * xy - x * y) / spread, 0.0) : 0;
  double start = n > 0 ? (y - slope * x) / n : kRounding;
  if (start < 0) {
    start = 0;
    slope = y / x;
  }
  cv::Mat noise(1, kLevels, CV_32F);
  for (int k = 0; k < kLevels; ++k) {
    noise.at<float>(k) = static_cast<float>(std::sqrt(std::max(start + slope * k, kRounding)));
  }
  return noise;
}

}  // namespace

void Background::learn(const cv::Mat& image) {
  if (image.empty() || image.type() != CV_8UC1)
    throw std::invalid_argument("image: must be 8-bit gray");
  if (count_ > 0 && image.size() != sum_.size())
    throw std::invalid_argument("image: its size differs from the first");
  if (count_ == 0) {
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

const cv::Mat& Background::noise_of_level() const {
  mean();
  if (noise_.empty())
    noise_ =
        fitted(count_ > 1 ? over_images(sum_, sum_of_squares_, count_) : over_neighbors(mean_));
  return noise_;
}

}  // namespace vitreo::vision
