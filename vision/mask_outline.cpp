// SPDX-License-Identifier: Apache-2.0
#include "vision/mask_outline.h"

#include "vision/evidence.h"

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo::vision {
namespace {

constexpr int kRounds = 5;          // of GrabCut
constexpr double kPointPx = 2.5;    // radius of what a point says
constexpr std::uint64_t kSeed = 4;  // of OpenCV's generator, which GrabCut's clustering draws from

bool inside(const std::vector<Eigen::Vector2d>& corners, double u, double v) {
  bool odd = false;
  for (std::size_t i = 0, j = corners.size() - 1; i < corners.size(); j = i++) {
    const Eigen::Vector2d &a = corners[i], &b = corners[j];
    if ((a.y() > v) != (b.y() > v) && u < (b.x() - a.x()) * (v - a.y()) / (b.y() - a.y()) + a.x())
      odd = !odd;
  }
  return odd;
}

void paint(cv::Mat& mask, const Ellipse& e) {
  if (!(e.semi_minor_px > 0) || !(e.semi_major_px >= e.semi_minor_px) || !e.vector().allFinite())
    throw std::invalid_argument("ellipse: wants a center and two axes above 0, the longer first");
  const int top =
      static_cast<int>(std::clamp(e.center_px.y() - e.semi_major_px, 0.0, double(mask.rows)));
  const int end =
      static_cast<int>(std::clamp(e.center_px.y() + e.semi_major_px + 2, 0.0, double(mask.rows)));
  for (int v = top; v < end; ++v) {
    const RowSpan span = row_of(e, v);
    for (int u = std::max(span.first, 0); u < std::min(span.end, mask.cols); ++u)
      mask.at<unsigned char>(v, u) = 255;
  }
}

void paint(cv::Mat& mask, const std::vector<Eigen::Vector2d>& corners) {
  if (corners.size() < 3) throw std::invalid_argument("polygon: wants three corners or more");
  for (int v = 0; v < mask.rows; ++v)
    for (int u = 0; u < mask.cols; ++u)
      if (inside(corners, u, v)) mask.at<unsigned char>(v, u) = 255;
}

void mark(cv::Mat& labels, const std::vector<Eigen::Vector2d>& points, unsigned char label) {
  for (const Eigen::Vector2d& p : points) {
    if (!(p.x() >= 0 && p.y() >= 0 && p.x() <= labels.cols - 1 && p.y() <= labels.rows - 1))
      throw std::invalid_argument("a point lies outside of the image");
    cv::Mat spot = cv::Mat::zeros(labels.size(), CV_8UC1);
    paint(spot, Ellipse{p, kPointPx, kPointPx, 0});
    labels.setTo(label, spot);
  }
}

cv::Mat largest_filled(const cv::Mat& mask) {
  std::vector<std::vector<cv::Point>> rims;
  cv::findContours(mask, rims, cv::RETR_EXTERNAL, cv::CHAIN_APPROX_NONE);
  cv::Mat filled = cv::Mat::zeros(mask.size(), CV_8UC1);
  if (rims.empty()) return filled;
  const auto largest = std::max_element(rims.begin(), rims.end(), [](const auto& a, const auto& b) {
    return cv::contourArea(a) < cv::contourArea(b);
  });
  cv::drawContours(filled, rims, static_cast<int>(largest - rims.begin()), cv::Scalar(255),
                   cv::FILLED);
  return filled;
}

}  // namespace

cv::Mat mask_of(const MaskOutline& outline, const cv::Size& size) {
  if (outline.ellipses.empty() && outline.polygons_px.empty())
    throw std::invalid_argument("outline: wants an ellipse or a polygon");
  cv::Mat mask = cv::Mat::zeros(size, CV_8UC1);
  for (const Ellipse& e : outline.ellipses) paint(mask, e);
  for (const auto& corners : outline.polygons_px) paint(mask, corners);
  if (cv::countNonZero(mask) == 0)
    throw std::invalid_argument("outline: no pixel of the image lies inside");
  return mask;
}

cv::Mat cut_by_color(const cv::Mat& image, const cv::Mat& rough, const MaskOutline& points,
                     double margin_px) {
  if (image.type() != CV_8UC3) throw std::invalid_argument("image: must be 8-bit color");
  if (rough.type() != CV_8UC1 || rough.size() != image.size() || cv::countNonZero(rough) == 0)
    throw std::invalid_argument("mask: must be 8-bit gray of the image's size, and not empty");
  cv::Mat outside, depth_in, depth_out;
  cv::compare(rough, 0, outside, cv::CMP_EQ);
  cv::distanceTransform(rough, depth_in, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  cv::distanceTransform(outside, depth_out, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  double deepest = 0;
  cv::minMaxLoc(depth_in, nullptr, &deepest);
  cv::Mat labels(image.size(), CV_8UC1, cv::Scalar(cv::GC_PR_BGD));
  labels.setTo(cv::GC_PR_FGD, rough);
  labels.setTo(cv::GC_BGD, depth_out > margin_px);
  labels.setTo(cv::GC_FGD, depth_in > std::min(margin_px, 0.6 * deepest));
  mark(labels, points.on_px, cv::GC_FGD);
  mark(labels, points.off_px, cv::GC_BGD);
  // Colors of the ground are those near the object: a far lamp or rim would only widen them.
  const int reach = static_cast<int>(3 * margin_px + 2 * deepest) + 10;
  cv::Rect box = cv::boundingRect(rough);
  box = cv::Rect(box.x - reach, box.y - reach, box.width + 2 * reach, box.height + 2 * reach) &
        cv::Rect({0, 0}, image.size());
  cv::Mat near = labels(box).clone(), object, ground;
  cv::theRNG().state = kSeed;
  cv::grabCut(image(box), near, {}, object, ground, kRounds, cv::GC_INIT_WITH_MASK);
  cv::Mat cut = cv::Mat::zeros(image.size(), CV_8UC1), is_object = (near & 1) * 255;
  is_object.copyTo(cut(box));
  cut = largest_filled(cut);
  if (cv::countNonZero(cut) == 0)
    throw std::invalid_argument("no color tells the object from the ground here");
  return cut;
}

std::vector<std::vector<Eigen::Vector2d>> contours_of(const cv::Mat& mask) {
  std::vector<std::vector<cv::Point>> rims;
  cv::findContours(mask, rims, cv::RETR_EXTERNAL, cv::CHAIN_APPROX_NONE);
  std::vector<std::vector<Eigen::Vector2d>> contours;
  for (const auto& rim : rims) {
    contours.emplace_back();
    for (const cv::Point& p : rim) contours.back().emplace_back(p.x, p.y);
  }
  return contours;
}

}  // namespace vitreo::vision
