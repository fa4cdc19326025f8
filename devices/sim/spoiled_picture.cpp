// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/spoiled_picture.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace vitreo::sim {
namespace {

constexpr double kSpeed = 60;          // px/s, at which a floater drifts from left to right
constexpr double kTransmission = 0.2;  // of the floater

// The point spread of a lens out of focus in geometric optics: a disc. Odd size, CV_32F, summing
// to 1.
cv::Mat disc(int radius_px) {
  cv::Mat kernel(2 * radius_px + 1, 2 * radius_px + 1, CV_32F);
  for (int v = -radius_px; v <= radius_px; ++v)
    for (int u = -radius_px; u <= radius_px; ++u)
      kernel.at<float>(v + radius_px, u + radius_px) =
          u * u + v * v <= radius_px * radius_px ? 1.F : 0.F;
  return kernel / cv::sum(kernel)[0];
}

// A dark disc that enters on the left, crosses the middle row, and enters again.
void draw_floater(cv::Mat& picture, int radius_px, double since) {
  const double way = picture.cols + 2.0 * radius_px;
  const double u = std::fmod(since * kSpeed, way) - radius_px;
  const double v = 0.5 * (picture.rows - 1);
  const cv::Rect box = cv::Rect(static_cast<int>(std::floor(u)) - radius_px - 1,
                                static_cast<int>(std::floor(v)) - radius_px - 1, 2 * radius_px + 4,
                                2 * radius_px + 4) &
                       cv::Rect(0, 0, picture.cols, picture.rows);
  for (int y = box.y; y < box.br().y; ++y)
    for (int x = box.x; x < box.br().x; ++x) {
      // with a soft edge
      const double inside = std::clamp(radius_px + 0.5 - std::hypot(x - u, y - v), 0.0, 1.0);
      auto* const pixel =
          picture.ptr<unsigned char>(y) + static_cast<std::ptrdiff_t>(x) * picture.channels();
      for (int c = 0; c < picture.channels(); ++c)
        pixel[c] = cv::saturate_cast<unsigned char>(pixel[c] * (1 - (1 - kTransmission) * inside));
    }
}

// As a camera sees it that is not where it was: mirrored, turned about the picture's middle, moved
// along its rows. What comes in from outside is the edge's own gray.
cv::Mat as_mounted(const cv::Mat& picture, const PictureFaults& faults) {
  cv::Mat seen;
  if (faults.mirrored)
    cv::flip(picture, seen, 1);
  else
    seen = picture;
  const cv::Point2f middle(0.5F * static_cast<float>(picture.cols - 1),
                           0.5F * static_cast<float>(picture.rows - 1));
  cv::Mat motion = cv::getRotationMatrix2D(middle, faults.turned * 180 / M_PI, 1);
  motion.at<double>(0, 2) += faults.shift_px;
  cv::Mat moved;
  cv::warpAffine(seen, moved, motion, seen.size(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  return moved;
}

}  // namespace

// In the order of the light's way: what floats in the eye, then the lens, then the exposure.
// Where nothing is wrong the same image goes on, so that faults cost nothing when there are none.
cv::Mat spoiled(const cv::Mat& picture, const PictureFaults& faults, Time exposed) {
  const bool moved = faults.shift_px != 0 || faults.turned != 0 || faults.mirrored;
  if (faults.light == 1 && faults.blur_px == 0 && faults.floater_px == 0 && !moved) return picture;
  cv::Mat worse = moved ? as_mounted(picture, faults) : picture.clone();
  if (faults.floater_px > 0)
    draw_floater(worse, faults.floater_px,
                 std::max(0.0, to_seconds(exposed - faults.floater_since)));
  if (faults.blur_px > 0)
    cv::filter2D(worse, worse, -1, disc(faults.blur_px), {-1, -1}, 0, cv::BORDER_REPLICATE);
  if (faults.light != 1) worse.convertTo(worse, -1, faults.light);
  return worse;
}

}  // namespace vitreo::sim
