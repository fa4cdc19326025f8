// Training of a color model from images with masks, and the ranking of channels (table 8.2).
// SPDX-License-Identifier: Apache-2.0
#include "vision/color_model.h"
#include "vision/color_statistics.h"
#include "vision/preconditions.h"

#include <opencv2/core.hpp>

#include <string>

namespace vitreo::vision {

// Bins above 64 would be finer than the table's cells.
void ColorModelSettings::check() const {
  require(bins >= 4 && bins <= 64, "bins: must be 4 to 64");
  require(smoothing_bins >= 0 && smoothing_bins <= 4, "smoothing_bins: must be 0 to 4");
  require(mixed >= 0 && mixed <= 1, "mixed: must be 0 to 1");
  require(neighborhood_px >= 1 && neighborhood_px <= 200, "neighborhood_px: must be 1 to 200");
  require(weight >= 1 && weight <= 1000, "weight: must be 1 to 1000");
}

// A mask that is empty or full leaves one of the two histograms without counts.
// Throws std::invalid_argument with the number of the image at fault, from 1.
void check_labeled(std::span<const LabeledImage> images) {
  require(!images.empty(), "images: none given");
  for (std::size_t k = 0; k < images.size(); ++k) {
    const std::string which = "image " + std::to_string(k + 1) + ": ";
    const cv::Mat& image = images[k].image;
    const cv::Mat& mask = images[k].mask;
    require(image.type() == CV_8UC3 && !image.empty(), which + "must be 8-bit color (BGR)");
    require(mask.type() == CV_8UC1, which + "its mask must be 8-bit gray");
    require(mask.size() == image.size(), which + "its mask has another size");
    const int count = cv::countNonZero(mask);
    require(count > 0, which + "its mask is empty");
    require(count < image.rows * image.cols, which + "its mask fills the image");
  }
}

// Thesis 8.1: the decision function F by joint histograms (8.1.1), its quality (8.1) and its
// thresholds (8.2), both on the training images.
// On the training images themselves, as the thesis does: the quality is that of a fit, not of a
// prediction.
ColorModel ColorModel::train(std::span<const LabeledImage> images,
                             const ColorModelSettings& settings) {
  settings.check();
  check_labeled(images);
  ColorCounts counts = count_colors(images);
  add_mixed_colors(counts, images, settings.mixed);
  ColorModel model;
  model.channels_ = settings.channels;
  model.table_ = compile_table(counts, settings);
  model.quality_ = quality_of(images, model.table_, settings.neighborhood_px);
  const auto both = thresholds_of(
      images, [&model](const cv::Mat& image) { return table_image(image, model.table_); },
      settings);
  model.flat_ = both[0];
  model.weighted_ = both[1];
  return model;
}

// Table 8.2 for these images: every pair of channels with its quality (8.1), mean and deviation.
// In the order of all_pairs(); the caller sorts.
std::vector<ChannelRank> ColorModel::rank(std::span<const LabeledImage> images,
                                          const ColorModelSettings& settings) {
  settings.check();
  check_labeled(images);
  const ColorCounts counts = count_colors(images);
  std::vector<ChannelRank> ranks;
  for (const Channels& channels : all_pairs()) {
    // The counts are by cell of RGB, so every color space is a sum over the same cells.
    ColorModelSettings chosen = settings;
    chosen.channels = channels;
    ranks.push_back(
        {channels, quality_of(images, compile_table(counts, chosen), settings.neighborhood_px)});
  }
  return ranks;
}

}  // namespace vitreo::vision
