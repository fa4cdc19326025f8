// SPDX-License-Identifier: Apache-2.0
#include "vision/registration_view.h"

#include "vision/preconditions.h"

#include <Eigen/Cholesky>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace vitreo::vision {
namespace {

constexpr int kSmallestSide = 64;
constexpr double kLeastContrast = 0.002;  // of the flattened view: below, it is blank

// Green of a color view, as vessels show best in it. Throws std::invalid_argument naming the view.
cv::Mat gray_of(const cv::Mat& view) {
  require(!view.empty() && view.dims == 2 && (view.type() == CV_8UC1 || view.type() == CV_8UC3),
          "view: wants an 8-bit gray or BGR image that is not empty");
  require(std::min(view.cols, view.rows) >= kSmallestSide, "view: wants at least 64 pixels a side");
  cv::Mat gray;
  if (view.channels() == 3)
    cv::extractChannel(view, gray, 1);
  else
    gray = view;
  cv::Mat result;
  gray.convertTo(result, CV_32F);
  return result;
}

// Vignette as a polynomial: least squares of all x^i y^j with i + j up to 4. The wide mean below
// cannot follow it at the border, and the remainder, the same in every view, would correlate views
// that have nothing else in common.
cv::Mat vignette_of(const cv::Mat& light) {
  using Terms = Eigen::Matrix<double, 15, 1>;
  const auto terms_at = [&](int u, int v) {
    const double x = 2.0 * u / light.cols - 1;
    const double y = 2.0 * v / light.rows - 1;
    Terms terms;
    int k = 0;
    for (int i = 0; i <= 4; ++i) {
      for (int j = 0; i + j <= 4; ++j) terms[k++] = std::pow(x, i) * std::pow(y, j);
    }
    return terms;
  };
  Eigen::Matrix<double, 15, 15> information = Eigen::Matrix<double, 15, 15>::Zero();
  Terms right = Terms::Zero();
  for (int v = 0; v < light.rows; ++v) {
    for (int u = 0; u < light.cols; ++u) {
      const Terms terms = terms_at(u, v);
      information.selfadjointView<Eigen::Lower>().rankUpdate(terms);
      right += light.at<float>(v, u) * terms;
    }
  }
  const Terms c = information.selfadjointView<Eigen::Lower>().ldlt().solve(right);
  cv::Mat vignette(light.size(), CV_32F);
  for (int v = 0; v < light.rows; ++v) {
    for (int u = 0; u < light.cols; ++u)
      vignette.at<float>(v, u) = static_cast<float>(std::max(c.dot(terms_at(u, v)), 1.0));
  }
  return vignette;
}

constexpr int kSaturated = 250;  // gray level

// Saturated pixels and the halo of each group of them: what saturates is a lamp's reflex, which
// stays in the sensor's frame while the retina moves. A reflex' flanks reach about as far beyond
// its saturated part as that is wide.
cv::Mat saturated_in(const cv::Mat& view) {
  cv::Mat most = view;
  if (view.channels() == 3) {
    std::vector<cv::Mat> planes;
    cv::split(view, planes);
    cv::min(planes[0], planes[1], most);  // white: red alone saturates in a fundus too
    cv::min(most, planes[2], most);
  }
  const cv::Mat full = most >= kSaturated;
  cv::Mat out = cv::Mat::zeros(view.size(), CV_8UC1);
  cv::Mat labels;
  cv::Mat statistics;
  cv::Mat centers;
  const int count = cv::connectedComponentsWithStats(full, labels, statistics, centers);
  for (int k = 1; k < count; ++k) {
    const int area = statistics.at<int>(k, cv::CC_STAT_AREA);
    if (area < 4) continue;
    const int more =
        std::clamp(static_cast<int>(1.4 * std::sqrt(area / std::numbers::pi)) + 3, 4, 40);
    const cv::Rect box(
        statistics.at<int>(k, cv::CC_STAT_LEFT), statistics.at<int>(k, cv::CC_STAT_TOP),
        statistics.at<int>(k, cv::CC_STAT_WIDTH), statistics.at<int>(k, cv::CC_STAT_HEIGHT));
    const cv::Rect around =
        cv::Rect(box.x - more, box.y - more, box.width + 2 * more, box.height + 2 * more) &
        cv::Rect({0, 0}, view.size());
    cv::Mat part = labels(around) == k;
    cv::dilate(part, part,
               cv::getStructuringElement(cv::MORPH_ELLIPSE, {2 * more + 1, 2 * more + 1}));
    out(around) |= part;
  }
  return out;
}

// Flat-field correction: the view, smoothed by 1 px, over its vignette times a wide Gaussian mean,
// both estimated on a small copy: uneven light goes, vessels stay.
// A small copy suffices, as light varies slowly; it makes the wide filter cheap.
cv::Mat flattened(const cv::Mat& gray, double sigma_px) {
  const double shrink = std::max(1.0, sigma_px / 3);
  const cv::Size size(std::max(8, static_cast<int>(gray.cols / shrink)),
                      std::max(8, static_cast<int>(gray.rows / shrink)));
  cv::Mat light;
  cv::Mat result;
  cv::resize(gray, light, size, 0, 0, cv::INTER_AREA);
  const cv::Mat vignette = vignette_of(light);
  cv::divide(light, vignette, light);
  cv::GaussianBlur(light, light, {0, 0}, sigma_px * size.width / gray.cols, 0, cv::BORDER_REFLECT);
  cv::multiply(light, vignette, light);
  cv::resize(light, light, gray.size(), 0, 0, cv::INTER_LINEAR);
  cv::GaussianBlur(gray, result, {0, 0}, 1);
  light = cv::max(light, 1.0);
  cv::divide(result, light, result);
  return result;
}

}  // namespace

void RegistrationSettings::check() const {
  require(max_rotation >= 0 && max_rotation <= std::numbers::pi, "max_rotation: must be 0 to pi");
  require(flatten_sigma_px >= 3 && flatten_sigma_px <= 1000, "flatten_sigma_px: must be 3 to 1000");
  require(min_overlap > 0 && min_overlap < 1, "min_overlap: must be between 0 and 1");
  require(min_correlation > 0 && min_correlation < 1, "min_correlation: must be between 0 and 1");
}

// Flattened and standardized, then a Gaussian pyramid with central differences.
// Standardized, so that views under another lamp correlate as well. A blank view keeps its values
// and is refused later.
RegistrationView::RegistrationView(const cv::Mat& view, const RegistrationSettings& settings)
    : size_(view.size()) {
  settings.check();
  cv::Mat gray = gray_of(view);
  const cv::Mat out = saturated_in(view);
  // The mean in place of a reflex: its light would darken the flattened view all round it.
  if (cv::countNonZero(out) > 0 && cv::countNonZero(out) < gray.rows * gray.cols)
    gray.setTo(cv::mean(gray, out == 0), out);
  cv::Mat flat = flattened(gray, settings.flatten_sigma_px);
  cv::Scalar mean;
  cv::Scalar contrast;
  cv::meanStdDev(flat, mean, contrast);
  blank_ = !(contrast[0] > kLeastContrast);
  flat = (flat - mean[0]) / (blank_ ? 1 : contrast[0]);
  for (Level& level : levels_) {
    level.image = flat.clone();
    cv::Sobel(flat, level.du, CV_32F, 1, 0, 1, 0.5);
    cv::Sobel(flat, level.dv, CV_32F, 0, 1, 1, 0.5);
    cv::pyrDown(flat, flat);
  }
  mask_levels(out);
}

// 0 is the flattened mean: what is left out correlates with nothing.
void RegistrationView::mask_levels(const cv::Mat& out) {
  cv::Mat left = out;
  for (Level& level : levels_) {
    if (left.size() != level.image.size())
      cv::resize(left, left, level.image.size(), 0, 0, cv::INTER_AREA);
    if (level.valid.empty()) level.valid = cv::Mat(level.image.size(), CV_8UC1, cv::Scalar(255));
    // Copies of a view share their pixels.
    level.valid = level.valid.clone();
    level.image = level.image.clone();
    level.valid.setTo(0, left != 0);
    level.image.setTo(0, left != 0);
  }
}

void RegistrationView::leave_out(const cv::Mat& fixed) {
  require(fixed.type() == CV_8UC1 && fixed.size() == size_,
          "fixed: must be 8-bit gray of the view's size");
  mask_levels(fixed);
}

}  // namespace vitreo::vision
