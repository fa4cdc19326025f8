// Disturbances of a training image: other light, other focus, compression, noise, cover, glare, by
// which training learns what a look at a worse image is worth.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/ellipse.h"

#include <opencv2/core/mat.hpp>

#include <cstdint>

namespace vitreo::vision {

constexpr int kDisturbances = 30;  ///< kinds, from 0; 0 is the image as it is

/// Whether a kind is another light alone: gains of the channels, about even over the object.
bool is_light(int kind);
/// Whether it is defocus.
bool is_blur(int kind);

/// `image` (CV_8UC3) as it would be under disturbance `kind`. `object`: where what is covered or
/// outshone lies. Same arguments, same image.
cv::Mat disturbed(const cv::Mat& image, const Ellipse& object, int kind, std::uint64_t seed);

}  // namespace vitreo::vision
