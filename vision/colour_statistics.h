// The sums behind a colour model: counts of colours, histograms, and how well their ratio tells object from ground.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/colour_model.h"

#include <array>

namespace vitreo::vision {

/// How often each cell of the table (ColourModel::cell_of) was seen. Every histogram is a sum over cells, so the images
/// are read once whatever the number of colour spaces.
struct ColourCounts {
  std::vector<double> object, ground;
};

ColourCounts count_colours(std::span<const LabelledImage> images);
/// Joint histograms of the settings' channels, smoothed; F of each cell, times ColourModel::kScale. A colour that
/// neither has shown gets F = 0.
std::vector<std::int8_t> compile_table(const ColourCounts& counts, const ColourModelSettings& settings);
/// (8.1): a pixel is object where F > 0. The ground is what lies within `neighbourhood_px` of the object.
Quality quality_of(std::span<const LabelledImage> images, const std::vector<std::int8_t>& table, int neighbourhood_px);
/// (8.2) on F as the tracker smooths it: the flat and the weighted reading (ColourModel).
std::array<Thresholds, 2> thresholds_of(std::span<const LabelledImage> images, const std::vector<std::int8_t>& table,
                                        const ColourModelSettings& settings);

}  // namespace vitreo::vision
