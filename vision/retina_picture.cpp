// SPDX-License-Identifier: Apache-2.0
#include "vision/retina_picture.h"

#include "vision/preconditions.h"

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <vector>

namespace vitreo::vision {
namespace {

// Of the map, around a frame.
cv::Rect map_box_of(const cv::Size& size, const Eigen::Affine2d& map_from_image) {
  Eigen::Vector2d low = Eigen::Vector2d::Constant(1e9);
  Eigen::Vector2d high = -low;
  for (const double u : {0.0, size.width - 1.0})
    for (const double v : {0.0, size.height - 1.0}) {
      const Eigen::Vector2d corner = map_from_image * Eigen::Vector2d(u, v);
      low = low.cwiseMin(corner);
      high = high.cwiseMax(corner);
    }
  return {cv::Point(cvFloor(low.x()), cvFloor(low.y())),
          cv::Point(cvCeil(high.x()) + 1, cvCeil(high.y()) + 1)};
}

// Falls off towards the border: no seam where two frames meet.
cv::Mat weight_towards_middle(const cv::Size& size) {
  cv::Mat weight(size, CV_32F);
  for (int v = 0; v < size.height; ++v)
    for (int u = 0; u < size.width; ++u)
      weight.at<float>(v, u) = static_cast<float>(
          1 + std::min({u, v, size.width - 1 - u, size.height - 1 - v, size.height / 4}));
  return weight;
}

}  // namespace

// Room for a rectangle of the map, in steps of 64 px; false where it would be too large.
bool RetinaPicture::make_room(const cv::Rect& wanted) {
  const cv::Rect have(static_cast<int>(origin_.x()), static_cast<int>(origin_.y()), sum_.cols,
                      sum_.rows);
  if (!sum_.empty() && (have & wanted) == wanted) return true;
  cv::Rect all = sum_.empty() ? wanted : (have | wanted);
  const auto down = [](int x) { return static_cast<int>(std::floor(x / 64.0)) * 64; };
  const cv::Point last(down(all.br().x) + 64, down(all.br().y) + 64);
  all = cv::Rect({down(all.x), down(all.y)}, last);
  if (static_cast<double>(all.width) * all.height > max_pixels_) return false;
  cv::Mat sum = cv::Mat::zeros(all.size(), CV_MAKETYPE(CV_32F, CV_MAT_CN(type_)));
  cv::Mat weight = cv::Mat::zeros(all.size(), CV_32F);
  if (!sum_.empty()) {
    const cv::Rect old(have.x - all.x, have.y - all.y, have.width, have.height);
    sum_.copyTo(sum(old));
    weight_.copyTo(weight(old));
  }
  sum_ = sum;
  weight_ = weight;
  origin_ = {all.x, all.y};
  return true;
}

void RetinaPicture::add(const cv::Mat& image, const Eigen::Affine2d& map_from_image) {
  require(image.type() == CV_8UC1 || image.type() == CV_8UC3,
          "image: must be 8-bit, gray or color");
  require(type_ < 0 || type_ == image.type(), "image: is not of the first's type");
  type_ = image.type();
  const cv::Rect box = map_box_of(image.size(), map_from_image);
  if (!make_room(box)) return;
  Eigen::Affine2d box_from_image = map_from_image;
  box_from_image.translation() -= Eigen::Vector2d(box.x, box.y);
  const Eigen::Matrix<double, 2, 3, Eigen::RowMajor> m = box_from_image.matrix().topRows<2>();
  const cv::Mat to(2, 3, CV_64F, const_cast<double*>(m.data()));
  cv::Mat light;
  image.convertTo(light, CV_MAKETYPE(CV_32F, image.channels()));
  cv::Mat there;
  cv::Mat share;
  cv::warpAffine(light, there, to, box.size(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  cv::warpAffine(weight_towards_middle(image.size()), share, to, box.size());
  const cv::Rect place(box.x - static_cast<int>(origin_.x()), box.y - static_cast<int>(origin_.y()),
                       box.width, box.height);
  weight_(place) += share;
  if (image.channels() == 3) cv::merge(std::vector<cv::Mat>(3, share), share);
  sum_(place) += there.mul(share);
}

cv::Mat RetinaPicture::image() const {
  if (sum_.empty()) return {};
  cv::Mat whole = cv::max(weight_, 1e-6);
  if (sum_.channels() == 3) cv::merge(std::vector<cv::Mat>(3, whole), whole);
  cv::Mat result;
  cv::divide(sum_, whole, result);
  result.convertTo(result, type_);
  return result;
}

cv::Mat stabilized(const cv::Mat& image, const RetinaPose& pose) {
  const Eigen::Matrix<double, 2, 3, Eigen::RowMajor> m = pose.map_from_image.matrix().topRows<2>();
  cv::Mat result;
  cv::warpAffine(image, result, cv::Mat(2, 3, CV_64F, const_cast<double*>(m.data())), image.size());
  return result;
}

}  // namespace vitreo::vision
