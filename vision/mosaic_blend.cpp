// Blending of a mosaic's views, whose poses are known, into one picture.
// SPDX-License-Identifier: Apache-2.0
#include "vision/mosaic.h"
#include "vision/preconditions.h"

#include <Eigen/Cholesky>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo::vision {
namespace {

constexpr double kKeepLight =
    0.01;                     // Tikhonov term: draws gains to 1 where no overlap determines them
constexpr int kSampling = 8;  // px between the samples that gains are estimated from

struct Bounds {
  Eigen::Vector2d low{1e30, 1e30};
  Eigen::Vector2d high{-1e30, -1e30};
  void add(const Eigen::Vector2d& p) { low = low.cwiseMin(p), high = high.cwiseMax(p); }
};

// An affine image of the view's rectangle is bounded by its corners' images.
// In the frame that `to_view` leads to.
Bounds bounds_of(const Eigen::Affine2d& to_view, const cv::Size& size) {
  Bounds bounds;
  const double right = size.width - 1;
  const double bottom = size.height - 1;
  for (const Eigen::Vector2d& corner : {Eigen::Vector2d(0, 0), Eigen::Vector2d(right, 0),
                                        Eigen::Vector2d(0, bottom), Eigen::Vector2d(right, bottom)})
    bounds.add(to_view * corner);
  return bounds;
}

// Feathering: a product of squared tents, 0 at the rim and 1 in the middle, so that a vignetted
// corner or a wrong light at the rim leaves no seam.
cv::Mat feather(const cv::Size& size) {
  cv::Mat weight(size, CV_32F);
  for (int v = 0; v < size.height; ++v) {
    for (int u = 0; u < size.width; ++u) {
      const double x = std::min(u + 0.5, size.width - u - 0.5) / (0.5 * size.width);
      const double y = std::min(v + 0.5, size.height - v - 0.5) / (0.5 * size.height);
      // Above 0 everywhere, so that a pixel that one rim alone covers still has a color.
      weight.at<float>(v, u) = static_cast<float>(x * x * y * y + 1e-6);
    }
  }
  return weight;
}

// Green of a color view, as registration uses it.
double gray_at(const cv::Mat& view, int u, int v) {
  return view.channels() == 3 ? view.at<cv::Vec3b>(v, u)[1] : view.at<unsigned char>(v, u);
}

// Mean logarithm of first over second over their overlap. Both views' vignettes are in it, and
// cancel on average.
// Nothing without usable common pixels. `first_from_second` by the adjusted poses, not by the
// link's own registration.
std::optional<double> log_ratio(const cv::Mat& first, const cv::Mat& second,
                                const Eigen::Affine2d& first_from_second) {
  double sum = 0;
  int count = 0;
  for (int v = 0; v < second.rows; v += kSampling) {
    for (int u = 0; u < second.cols; u += kSampling) {
      const Eigen::Vector2d p = first_from_second * Eigen::Vector2d(u, v);
      if (!(p.x() >= 0 && p.y() >= 0 && p.x() <= first.cols - 1 && p.y() <= first.rows - 1))
        continue;
      const double a = gray_at(first, static_cast<int>(p.x()), static_cast<int>(p.y()));
      const double b = gray_at(second, u, v);
      if (a < 1 || b < 1 || a > 254 || b > 254)
        continue;  // black and saturated pixels carry no ratio
      sum += std::log(a / b);
      ++count;
    }
  }
  return count == 0 ? std::nullopt : std::optional(sum / count);
}

// Gain compensation (as Brown & Lowe 2007, on logarithms): least squares of log g_second - log
// g_first = log(first / second) over all links, with the prior log g = 0. The matrix is the graph's
// Laplacian.
// The prior keeps views without links at 1, and the common factor that the ratios leave open.
std::vector<double> gains_of(std::span<const cv::Mat> views, const MosaicPlan& plan) {
  const auto n = static_cast<Eigen::Index>(views.size());
  Eigen::MatrixXd information = kKeepLight * Eigen::MatrixXd::Identity(n, n);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(n);
  for (const MosaicLink& link : plan.links) {
    if (!link.used) continue;
    const Eigen::Affine2d first_from_second =
        plan.mosaic_from_view[static_cast<std::size_t>(link.first)]->inverse() *
        *plan.mosaic_from_view[static_cast<std::size_t>(link.second)];
    const auto ratio = log_ratio(views[static_cast<std::size_t>(link.first)],
                                 views[static_cast<std::size_t>(link.second)], first_from_second);
    if (!ratio) continue;
    information(link.first, link.first) += 1, information(link.second, link.second) += 1;
    information(link.first, link.second) -= 1, information(link.second, link.first) -= 1;
    right[link.second] += *ratio, right[link.first] -= *ratio;
  }
  const Eigen::VectorXd logs = information.ldlt().solve(right);
  std::vector<double> gains;
  for (const double log : logs) gains.push_back(std::exp(log));
  return gains;
}

// Throws std::invalid_argument naming plan or views.
void check_plan(std::span<const cv::Mat> views, const MosaicPlan& plan) {
  require(!views.empty() && views.size() == plan.mosaic_from_view.size(),
          "plan: must be made of these views");
  require(plan.joined() > 0, "plan: no two views could be joined");
  for (const cv::Mat& view : views) {
    require(view.size() == views[0].size() && view.type() == views[0].type() && !view.empty() &&
                (view.type() == CV_8UC1 || view.type() == CV_8UC3),
            "views: must be 8-bit gray or BGR, of one size and type");
  }
}

struct Canvas {
  cv::Mat sum;
  cv::Mat weight;
};

// Adds a warped view to the weighted sum, within its bounding box. Replicated borders keep the
// color where the weight, warped alike, fades to 0.
// `image_from_view` leads to pixels of the canvas.
void add_view(Canvas& canvas, const cv::Mat& view, const cv::Mat& view_weight, double gain,
              const Eigen::Affine2d& image_from_view) {
  const Bounds bounds = bounds_of(image_from_view, view.size());
  const cv::Point low(static_cast<int>(std::floor(bounds.low.x())),
                      static_cast<int>(std::floor(bounds.low.y())));
  const cv::Point high(static_cast<int>(std::ceil(bounds.high.x())) + 1,
                       static_cast<int>(std::ceil(bounds.high.y())) + 1);
  const cv::Rect area = cv::Rect(low, high) & cv::Rect(0, 0, canvas.sum.cols, canvas.sum.rows);
  const Eigen::Affine2d area_from_view = Eigen::Translation2d(-area.x, -area.y) * image_from_view;
  Eigen::Matrix<double, 2, 3, Eigen::RowMajor> m = area_from_view.matrix().topRows<2>();
  const cv::Mat matrix(2, 3, CV_64F, m.data());
  cv::Mat color;
  cv::Mat weight;
  view.convertTo(color, CV_32F, gain);
  cv::warpAffine(color, color, matrix, area.size(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  cv::warpAffine(view_weight, weight, matrix, area.size(), cv::INTER_LINEAR, cv::BORDER_CONSTANT);
  canvas.weight(area) += weight;
  if (view.channels() == 3) cv::merge(std::vector<cv::Mat>{weight, weight, weight}, weight);
  cv::multiply(color, weight, color);
  canvas.sum(area) += color;
}

}  // namespace

// Weighted mean sum(w g I) / sum(w) of the views on the integer grid of their bounding box.
// Where no view is, the picture is black and `cover` is 0. Throws std::length_error before anything
// large is allocated.
Mosaic blend_mosaic(std::span<const cv::Mat> views, const MosaicPlan& plan,
                    const MosaicSettings& settings) {
  settings.check();
  check_plan(views, plan);
  Bounds bounds;
  for (const auto& pose : plan.mosaic_from_view) {
    if (!pose) continue;
    const Bounds own = bounds_of(*pose, views[0].size());
    bounds.add(own.low), bounds.add(own.high);
  }
  const Eigen::Vector2d low = bounds.low.array().floor();
  const Eigen::Vector2d extent = bounds.high.array().ceil() - low.array() + 1;
  if (!(extent.x() * extent.y() <= settings.max_pixels))
    throw std::length_error("the mosaic would have more pixels than max_pixels");
  Mosaic mosaic;
  mosaic.image_from_mosaic = Eigen::Translation2d(-low);
  mosaic.gains = gains_of(views, plan);
  const cv::Size size(static_cast<int>(extent.x()), static_cast<int>(extent.y()));
  Canvas canvas{cv::Mat::zeros(size, CV_MAKETYPE(CV_32F, views[0].channels())),
                cv::Mat::zeros(size, CV_32F)};
  const cv::Mat weight = feather(views[0].size());
  for (std::size_t k = 0; k < views.size(); ++k) {
    if (plan.mosaic_from_view[k])
      add_view(canvas, views[k], weight, mosaic.gains[k],
               mosaic.image_from_mosaic * *plan.mosaic_from_view[k]);
    else
      mosaic.gains[k] = 1;
  }
  mosaic.cover = canvas.weight > 0;
  // Pixels without a view have the sum 0; the floor keeps them 0.
  cv::Mat divisor = cv::max(canvas.weight, 1e-12);
  if (views[0].channels() == 3) cv::merge(std::vector<cv::Mat>{divisor, divisor, divisor}, divisor);
  cv::divide(canvas.sum, divisor, canvas.sum);
  canvas.sum.convertTo(mosaic.image, views[0].type());
  return mosaic;
}

}  // namespace vitreo::vision
