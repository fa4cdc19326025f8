// Color statistics behind a color model: counts, histograms, the quality measure (8.1) and the
// thresholds (8.2).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/color_model.h"

#include <array>
#include <functional>

namespace vitreo::vision {

/// How often each cell of the table (ColorModel::cell_of) occurred. Every histogram is a sum over
/// cells, so the images are read once whatever the number of color spaces.
struct ColorCounts {
  std::vector<double> object;
  std::vector<double> ground;
};

ColorCounts count_colors(std::span<const LabeledImage> images);
/// Beside them, `share` of all of each side: the colors that defocus mixes at the object's rim,
/// which are the object's where more than half of the mixture is.
void add_mixed_colors(ColorCounts& counts, std::span<const LabeledImage> images, double share);
/// Joint histograms of the settings' channels, smoothed; F of each cell, times ColorModel::kScale.
/// A color that occurred in neither gets F = 0.
std::vector<std::int8_t> compile_table(const ColorCounts& counts,
                                       const ColorModelSettings& settings);
/// (8.1): a pixel is object where F > 0. The ground is what lies within `neighborhood_px` of the
/// object.
Quality quality_of(std::span<const LabeledImage> images, const std::vector<std::int8_t>& table,
                   int neighborhood_px);
/// F of every pixel of an image, CV_32F, in natural units.
using EvidenceImage = std::function<cv::Mat(const cv::Mat& image)>;
/// (8.2) on F as the tracker smooths it: the flat and the weighted reading (ColorModel).
std::array<Thresholds, 2> thresholds_of(std::span<const LabeledImage> images,
                                        const EvidenceImage& evidence,
                                        const ColorModelSettings& settings);
/// The table's.
cv::Mat table_image(const cv::Mat& image, const std::vector<std::int8_t>& table);

}  // namespace vitreo::vision
