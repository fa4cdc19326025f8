// Color model of object and background, learnt from images with masks (thesis 8.1) and compiled
// into one table: a pixel's log-likelihood ratio is one look-up, whatever the color space.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/color_space.h"

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace vitreo::vision {

struct LabeledImage {
  cv::Mat image;  ///< CV_8UC3, BGR
  cv::Mat mask;   ///< CV_8UC1 of the same size, not zero on the object
};

/// (8.1) of each image, with the mean and the standard deviation over the images; in [-2, 2].
struct Quality {
  double mean = 0;
  double deviation = 0;
  std::vector<double> of_image;
};

/// t_l and t_h of thesis 8.1.2, of F = log(P(u|object) / P(u|ground)): object above `high`, ground
/// below `low`, between them undecided.
struct Thresholds {
  double low = 0;
  double high = 0;
  bool operator==(const Thresholds&) const = default;
};

struct ColorModelSettings {
  /// All three of RGB by default: through the table they cost no more than a pair.
  Channels channels;
  int bins = 32;                ///< of the histogram, along each channel
  double smoothing_bins = 0.6;  ///< standard deviation of the Gaussian on the histograms
  /// Share of the colors that a lens out of focus would mix of object and ground, beside those
  /// seen: with 0.1 an object out of focus is followed that is lost without; before vessels of
  /// nearly its own color some sharp ones are lost for it (docs/vision.md).
  double mixed = 0;
  /// Radius of the disc omega of thesis 8.1.1: how far around the object the ground counts.
  int neighborhood_px = 12;
  /// Of a wrong decision against an undecided pixel, in the weighted reading of (8.2).
  double weight = 8;
  void check() const;  ///< throws std::invalid_argument naming the setting
};

struct ChannelRank {
  Channels channels;
  Quality quality;
};

/// Throws std::invalid_argument, naming the image, unless there is at least one and each is CV_8UC3
/// with a CV_8UC1 mask of its size that is neither empty nor full.
void check_labeled(std::span<const LabeledImage> images);

class ColorModel {
 public:
  static constexpr int kLevels = 64;    // of the table, along each of blue, green, red
  static constexpr double kScale = 16;  // of the table's entries: int8, F up to +-7.9

  /// Throws std::invalid_argument as check_labeled and settings.check().
  static ColorModel train(std::span<const LabeledImage> images, const ColorModelSettings& settings);
  /// Table 8.2: all eighteen pairs in its order. `settings.channels` is not read.
  static std::vector<ChannelRank> rank(std::span<const LabeledImage> images,
                                       const ColorModelSettings& settings);

  std::string save() const;
  /// Throws std::invalid_argument for anything that save() did not write.
  static ColorModel load(std::string_view bytes);

  static std::size_t cell_of(unsigned blue, unsigned green, unsigned red) {
    return (blue >> 2) << 12 | (green >> 2) << 6 | red >> 2;
  }
  const std::vector<std::int8_t>& table() const { return table_; }  ///< by cell_of, kScale F
  const Channels& channels() const { return channels_; }
  const Quality& quality() const { return quality_; }
  /// (8.2) as it stands has its optimum at t_l = t_h, since it separates into g(t_l) + g(t_h) with
  /// the same g; so this is how far that optimum is flat: the ends of {t : g(t) <= min g + 0.001},
  /// averaged over the images.
  const Thresholds& flat_thresholds() const { return flat_; }
  /// (8.2) with wrong decisions weighted more than undecided ones, which opens a gap by itself.
  const Thresholds& weighted_thresholds() const { return weighted_; }

 private:
  Channels channels_;
  Quality quality_;
  Thresholds flat_;
  Thresholds weighted_;
  std::vector<std::int8_t> table_;
};

}  // namespace vitreo::vision
