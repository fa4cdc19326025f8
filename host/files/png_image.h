// PNG of an image, encoded by the first who wants its bytes: not by the loop that took the picture.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core/mat.hpp>

#include <mutex>
#include <string>
#include <vector>

namespace vitreo {

class PngImage {
 public:
  /// PNG holds 8 and 16 bits a channel, gray, BGR or BGRA, without loss: std::invalid_argument for
  /// anything else. `name`: how errors call it. The image is shared, and must not change.
  PngImage(std::string name, cv::Mat image);
  /// Of a file that was read.
  explicit PngImage(std::vector<unsigned char> bytes) : bytes_(std::move(bytes)) {}
  /// Any thread; the image is let go once it is encoded. Throws std::runtime_error where it cannot
  /// be.
  const std::vector<unsigned char>& bytes();

 private:
  const std::string name_;
  std::mutex mutex_;
  cv::Mat image_;
  std::vector<unsigned char> bytes_;
};

}  // namespace vitreo
