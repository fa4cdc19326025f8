// SPDX-License-Identifier: Apache-2.0
#include "devices/roles/gray.h"

#include <opencv2/core.hpp>

#include <stdexcept>
#include <vector>

namespace vitreo {

// Always a copy or a new image: a Frame's pixels belong to its receiver.
cv::Mat in_gray(const cv::Mat& image, int bits) {
  // White stays white: 2^bits - 1 becomes 255. convertTo() rounds and saturates.
  cv::Mat eight;
  if (image.depth() == CV_8U)
    eight = image;
  else if (image.depth() == CV_16U)
    image.convertTo(eight, CV_8U, 255. / ((1 << bits) - 1));
  else
    throw std::invalid_argument("neither 8 nor 16 bits per channel");
  if (eight.channels() == 1) return eight.clone();  // the caller may write to its image again
  if (eight.channels() < 3) throw std::invalid_argument("neither gray nor color");
  // Luma, ITU-R BT.601: Y = 0.299 R + 0.587 G + 0.114 B, in OpenCV's order of channels.
  cv::Mat gray;
  const cv::Matx<float, 1, 4> of_bgra(0.114F, 0.587F, 0.299F, 0);
  const cv::Matx<float, 1, 3> of_bgr(0.114F, 0.587F, 0.299F);
  if (eight.channels() == 4)
    cv::transform(eight, gray, of_bgra);
  else
    cv::transform(eight, gray, of_bgr);
  return gray;
}

cv::Mat as_color(const cv::Mat& image) {
  if (image.type() != CV_8UC1) return image;
  cv::Mat color;
  const cv::Mat levels[] = {image, image, image};
  cv::merge(levels, 3, color);
  return color;
}

cv::Mat as_gray(const cv::Mat& image) { return image.type() == CV_8UC1 ? image : in_gray(image); }

}  // namespace vitreo
