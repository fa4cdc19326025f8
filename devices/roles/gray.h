// Conversion of images to 8-bit gray, for the frames of a camera without color.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core/mat.hpp>

namespace vitreo {

/// 16-bit images are divided by 257, so that white stays white; of colors the luma (ITU-R BT.601,
/// as everywhere in OpenCV), of BGRA without its alpha. A copy. Throws std::invalid_argument for
/// other depths.
cv::Mat in_gray(const cv::Mat& image);

}  // namespace vitreo
