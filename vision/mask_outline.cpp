// SPDX-License-Identifier: Apache-2.0
#include "vision/mask_outline.h"

#include "vision/evidence.h"
#include "vision/preconditions.h"

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace vitreo::vision {
namespace {

constexpr int kGrabCutRounds = 5;
constexpr double kPointPx = 2.5;           // radius of a point's mark
constexpr std::uint64_t kGrabCutSeed = 4;  // of OpenCV's generator, which initializes its k-means

// Even-odd rule: a ray towards +u crosses the outline an odd number of times from an inner point.
// A corner belongs to one of its two edges only, so a ray through it crosses once.
bool inside_polygon(const std::vector<Eigen::Vector2d>& corners, double u, double v) {
  bool odd = false;
  for (std::size_t i = 0, j = corners.size() - 1; i < corners.size(); j = i++) {
    const Eigen::Vector2d& a = corners[i];
    const Eigen::Vector2d& b = corners[j];
    if ((a.y() > v) != (b.y() > v) && u < (b.x() - a.x()) * (v - a.y()) / (b.y() - a.y()) + a.x())
      odd = !odd;
  }
  return odd;
}

// Pixels whose centers lie within; what is outside of the image is not painted.
void paint_ellipse(cv::Mat& mask, const Ellipse& e) {
  require(e.semi_minor_px > 0 && e.semi_major_px >= e.semi_minor_px && e.vector().allFinite(),
          "ellipse: wants a center and two axes above 0, the longer first");
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

void paint_polygon(cv::Mat& mask, const std::vector<Eigen::Vector2d>& corners) {
  require(corners.size() >= 3, "polygon: wants three corners or more");
  for (int v = 0; v < mask.rows; ++v)
    for (int u = 0; u < mask.cols; ++u)
      if (inside_polygon(corners, u, v)) mask.at<unsigned char>(v, u) = 255;
}

// Gives the pixels around each point the label.
// Throws std::invalid_argument for a point outside: it would be lost without a word.
void mark_points(cv::Mat& labels, const std::vector<Eigen::Vector2d>& points, unsigned char label) {
  for (const Eigen::Vector2d& p : points) {
    require(p.x() >= 0 && p.y() >= 0 && p.x() <= labels.cols - 1 && p.y() <= labels.rows - 1,
            "a point lies outside of the image");
    cv::Mat spot = cv::Mat::zeros(labels.size(), CV_8UC1);
    paint_ellipse(spot, Ellipse{p, kPointPx, kPointPx, 0});
    labels.setTo(label, spot);
  }
}

// The component of largest area, its holes filled.
// A body has no holes: a highlight that was cut out belongs to it.
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

// 255 inside of any of them. Throws std::invalid_argument where nothing is inside: training needs
// an object.
cv::Mat mask_of(const MaskOutline& outline, const cv::Size& size) {
  require(!outline.ellipses.empty() || !outline.polygons_px.empty(),
          "outline: wants an ellipse or a polygon");
  cv::Mat mask = cv::Mat::zeros(size, CV_8UC1);
  for (const Ellipse& e : outline.ellipses) paint_ellipse(mask, e);
  for (const auto& corners : outline.polygons_px) paint_polygon(mask, corners);
  require(cv::countNonZero(mask) > 0, "outline: no pixel of the image lies inside");
  return mask;
}

// GrabCut (Rother, Kolmogorov & Blake 2004): Gaussian mixtures of the colors of object and ground
// and a graph cut, in turn. Distances to the rough outline fix what is sure: farther than the
// margin outside is ground; deeper inside, or than 0.6 of the deepest where the object is thin, is
// object.
// OpenCV's generator gets a fixed state, so that the same clicks give the same mask. Throws
// std::invalid_argument where the colors do not separate.
cv::Mat cut_by_color(const cv::Mat& image, const cv::Mat& rough, const MaskOutline& points,
                     double margin_px) {
  require(image.type() == CV_8UC3, "image: must be 8-bit color");
  require(rough.type() == CV_8UC1 && rough.size() == image.size() && cv::countNonZero(rough) > 0,
          "mask: must be 8-bit gray of the image's size, and not empty");
  cv::Mat outside;
  cv::Mat depth_in;
  cv::Mat depth_out;
  cv::compare(rough, 0, outside, cv::CMP_EQ);
  cv::distanceTransform(rough, depth_in, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  cv::distanceTransform(outside, depth_out, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  double deepest = 0;
  cv::minMaxLoc(depth_in, nullptr, &deepest);
  cv::Mat labels(image.size(), CV_8UC1, cv::Scalar(cv::GC_PR_BGD));
  labels.setTo(cv::GC_PR_FGD, rough);
  labels.setTo(cv::GC_BGD, depth_out > margin_px);
  labels.setTo(cv::GC_FGD, depth_in > std::min(margin_px, 0.6 * deepest));
  mark_points(labels, points.on_px, cv::GC_FGD);
  mark_points(labels, points.off_px, cv::GC_BGD);
  // Colors of the ground are learnt near the object: a far lamp or rim would only widen them.
  const int reach = static_cast<int>(3 * margin_px + 2 * deepest) + 10;
  cv::Rect box = cv::boundingRect(rough);
  box = cv::Rect(box.x - reach, box.y - reach, box.width + 2 * reach, box.height + 2 * reach) &
        cv::Rect({0, 0}, image.size());
  cv::Mat near = labels(box).clone();
  cv::Mat object;
  cv::Mat ground;
  cv::theRNG().state = kGrabCutSeed;
  cv::grabCut(image(box), near, {}, object, ground, kGrabCutRounds, cv::GC_INIT_WITH_MASK);
  cv::Mat cut = cv::Mat::zeros(image.size(), CV_8UC1);
  cv::Mat is_object = (near & 1) * 255;  // GC_FGD and GC_PR_FGD are odd
  is_object.copyTo(cut(box));
  cut = largest_filled(cut);
  require(cv::countNonZero(cut) > 0, "no color tells the object from the ground here");
  return cut;
}

// Borders traced through the centers of the outermost pixels (Suzuki & Abe 1985, OpenCV's
// findContours).
// Outer borders only.
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
