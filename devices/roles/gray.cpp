// SPDX-License-Identifier: Apache-2.0
#include "devices/roles/gray.h"

#include <opencv2/core.hpp>

#include <stdexcept>
#include <vector>

namespace vitreo {

cv::Mat in_gray(const cv::Mat& image) {
  cv::Mat eight;
  if (image.depth() == CV_8U)
    eight = image;
  else if (image.depth() == CV_16U)
    image.convertTo(eight, CV_8U, 1. / 257);
  else
    throw std::invalid_argument("neither 8 nor 16 bits per channel");
  if (eight.channels() == 1) return eight.clone();
  if (eight.channels() < 3) throw std::invalid_argument("neither gray nor color");
  cv::Mat gray;
  const cv::Matx<float, 1, 4> of_bgra(0.114F, 0.587F, 0.299F, 0);
  const cv::Matx<float, 1, 3> of_bgr(0.114F, 0.587F, 0.299F);
  if (eight.channels() == 4)
    cv::transform(eight, gray, of_bgra);
  else
    cv::transform(eight, gray, of_bgr);
  return gray;
}

}  // namespace vitreo
