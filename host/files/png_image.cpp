// SPDX-License-Identifier: Apache-2.0
#include "host/files/png_image.h"

#include <opencv2/imgcodecs.hpp>

#include <stdexcept>
#include <utility>

namespace vitreo {

PngImage::PngImage(std::string name, cv::Mat image)
    : name_(std::move(name)), image_(std::move(image)) {
  const bool depth_fits = image_.depth() == CV_8U || image_.depth() == CV_16U;
  const int channels = image_.channels();
  if (image_.empty() || image_.dims != 2 || !depth_fits ||
      (channels != 1 && channels != 3 && channels != 4)) {
    throw std::invalid_argument("picture \"" + name_ +
                                "\" must be gray or color, 8 or 16 bit, and not empty");
  }
}

const std::vector<unsigned char>& PngImage::bytes() {
  const std::lock_guard lock(mutex_);
  if (!image_.empty()) {
    if (!cv::imencode(".png", image_, bytes_))
      throw std::runtime_error("picture \"" + name_ + "\" cannot be made a PNG");
    image_.release();
  }
  return bytes_;
}

}  // namespace vitreo
