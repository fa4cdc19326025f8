// SPDX-License-Identifier: Apache-2.0
#include "vision/blob_search.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <vector>

namespace vitreo::vision {
namespace {

using Points = std::vector<cv::Point>;

// The ellipse with the moments of the outline's convex hull, in px of the image: highlights open a
// robot's mask, its hull closes it. Axes and angle as MomentSums::ellipse. `area` in px^2.
// `where` and `step`: the mask's cell (0, 0) is the pixel where.tl(), its cells are `step` px
// apart.
Ellipse hull_ellipse(const Points& outline, const cv::Rect& where, int step, double& area) {
  Points hull;
  cv::convexHull(outline, hull);
  const cv::Moments m = cv::moments(hull);
  // The outline runs through the centers of the outermost cells: half a cell is missing all round.
  const double grow = step / 2.0;
  area = m.m00 * step * step;
  if (!(m.m00 > 0)) return {};
  const Eigen::Vector2d center(where.x + step * m.m10 / m.m00, where.y + step * m.m01 / m.m00);
  const double xx = m.mu20 / m.m00;
  const double yy = m.mu02 / m.m00;
  const double xy = m.mu11 / m.m00;
  const double mean = (xx + yy) / 2;
  const double spread = std::hypot((xx - yy) / 2, xy);
  return {center, step * 2 * std::sqrt(mean + spread) + grow,
          step * 2 * std::sqrt(std::max(mean - spread, 0.0)) + grow,
          std::atan2(2 * xy, xx - yy) / 2};
}

}  // namespace

// The band of gray levels that each pixel of the empty scene may show: beyond `threshold_sigma`
// standard deviations, and `min_contrast`, a pixel is foreground. Its ends are the outermost whole
// levels within it, so that two comparisons of bytes decide as the real numbers would.
BlobSearch::BlobSearch(const Background& background, const BlobLimits& limits) : limits_(limits) {
  const cv::Mat& mean = background.mean();
  const cv::Mat& noise = background.noise_of_level();
  // The mean of n images has noise of its own: the difference has the variance (1 + 1 / n) sigma^2.
  const double sigmas = limits.threshold_sigma * std::sqrt(1 + 1.0 / background.count());
  low_.create(mean.size(), CV_8U);
  high_.create(mean.size(), CV_8U);
  for (int v = 0; v < mean.rows; ++v) {
    const float* row = mean.ptr<float>(v);
    for (int u = 0; u < mean.cols; ++u) {
      const double level = row[u];
      const double step =
          std::max(limits.min_contrast, sigmas * noise.at<float>(static_cast<int>(level)));
      low_.at<unsigned char>(v, u) = cv::saturate_cast<unsigned char>(std::ceil(level - step));
      high_.at<unsigned char>(v, u) = cv::saturate_cast<unsigned char>(std::floor(level + step));
    }
  }
}

// Foreground of every `step`-th pixel, as 255 and 0; the closing fills one-pixel gaps.
// `where` must lie in the image. Fewer pixels than the image has are read: the speed of the search
// goes with step squared.
cv::Mat BlobSearch::mask(const cv::Mat& image, const cv::Rect& where, int step) const {
  cv::Mat mask((where.height + step - 1) / step, (where.width + step - 1) / step, CV_8U);
  for (int j = 0; j < mask.rows; ++j) {
    const int v = where.y + step * j;
    const unsigned char* gray = image.ptr<unsigned char>(v) + where.x;
    const unsigned char* low = low_.ptr<unsigned char>(v) + where.x;
    const unsigned char* high = high_.ptr<unsigned char>(v) + where.x;
    unsigned char* out = mask.ptr<unsigned char>(j);
    for (int i = 0; i < mask.cols; ++i) {
      const int u = step * i;
      // Without a branch, so that the compiler vectorizes: -1 is 255.
      out[i] = static_cast<unsigned char>(
          -(static_cast<int>(gray[u] < low[u]) | static_cast<int>(gray[u] > high[u])));
    }
  }
  cv::morphologyEx(mask, mask, cv::MORPH_CLOSE, cv::Mat::ones(3, 3, CV_8U));
  return mask;
}

// By area, of the components whose hull ellipse has a size that the robot can have.
// `cut` asks the caller to search a larger region: the blob's ellipse is then that of a part.
std::optional<Blob> BlobSearch::largest(const cv::Mat& image, const cv::Rect& where,
                                        int step) const {
  const cv::Mat found = mask(image, where, step);
  std::vector<Points> outlines;
  cv::findContours(found, outlines, cv::RETR_EXTERNAL, cv::CHAIN_APPROX_NONE);
  std::optional<Blob> best;
  for (const Points& outline : outlines) {
    if (outline.size() < 6) continue;
    Blob blob;
    blob.ellipse = hull_ellipse(outline, where, step, blob.area_px);
    // Wider than the limits: the mask's edge is not the rim; the contour decides.
    if (blob.ellipse.semi_minor_px < 0.6 * limits_.min_semi_minor_px) continue;
    if (blob.ellipse.semi_major_px > 1.3 * limits_.max_semi_major_px + 2 * step) continue;
    if (best && best->area_px >= blob.area_px) continue;
    // Cut: the component touches the region's border where the image goes on.
    const cv::Rect box = cv::boundingRect(outline);
    blob.cut = (box.x == 0 && where.x > 0) || (box.y == 0 && where.y > 0) ||
               (box.x + box.width == found.cols && where.x + where.width < image.cols) ||
               (box.y + box.height == found.rows && where.y + where.height < image.rows);
    best = blob;
  }
  return best;
}

}  // namespace vitreo::vision
