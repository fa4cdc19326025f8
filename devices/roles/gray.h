// Conversion of images to 8-bit gray, for the frames of a camera without color, and of gray ones to
// three channels, for what looks at colors.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core/mat.hpp>

namespace vitreo {

/// Of a 16-bit image the low `bits` count (1 to 16); their largest number becomes 255; of colors
/// the luma (ITU-R BT.601, as everywhere in OpenCV), of BGRA without its alpha. A copy. Throws
/// std::invalid_argument for other depths.
cv::Mat in_gray(const cv::Mat& image, int bits = 16);

/// The same image where it is 8-bit gray already, sharing its pixels; else in_gray().
cv::Mat as_gray(const cv::Mat& image);

/// The same image where it is CV_8UC3 already, sharing its pixels; of a gray one (CV_8UC1) its
/// level in blue, green and red. Others as they are.
cv::Mat as_color(const cv::Mat& image);

}  // namespace vitreo
