// SPDX-License-Identifier: Apache-2.0
#include "vision/color_model.h"

#include "vision/bytes.h"
#include "vision/color_statistics.h"
#include "vision/preconditions.h"

#include <opencv2/core.hpp>

#include <algorithm>
#include <array>
#include <cmath>

namespace vitreo::vision {
namespace {

constexpr std::string_view kColorMagic = "VTCM";
constexpr std::uint32_t kColorVersion = 1;
constexpr std::size_t kTableSize =
    static_cast<std::size_t>(ColorModel::kLevels) * ColorModel::kLevels * ColorModel::kLevels;

// F is within +-7.9 by the table's int8, so its thresholds are within +-8.
Thresholds load_thresholds(ByteReader& in) {
  Thresholds t;
  t.low = in.f64(-8, 8);
  t.high = in.f64(-8, 8);
  if (t.low > t.high) in.fail("its lower threshold is above the higher");
  return t;
}

}  // namespace

void ColorModelSettings::check() const {
  require(bins >= 4 && bins <= 64, "bins: must be 4 to 64");
  require(smoothing_bins >= 0 && smoothing_bins <= 4, "smoothing_bins: must be 0 to 4");
  require(neighborhood_px >= 1 && neighborhood_px <= 200, "neighborhood_px: must be 1 to 200");
  require(weight >= 1 && weight <= 1000, "weight: must be 1 to 1000");
}

// A mask that is empty or full leaves one of the two histograms without counts.
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
ColorModel ColorModel::train(std::span<const LabeledImage> images,
                             const ColorModelSettings& settings) {
  settings.check();
  check_labeled(images);
  const ColorCounts counts = count_colors(images);
  ColorModel model;
  model.channels_ = settings.channels;
  model.table_ = compile_table(counts, settings);
  model.quality_ = quality_of(images, model.table_, settings.neighborhood_px);
  const auto both = thresholds_of(images, model.table_, settings);
  model.flat_ = both[0];
  model.weighted_ = both[1];
  return model;
}

// Table 8.2 for these images: every pair of channels with its quality (8.1), mean and deviation.
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

// Format "VTCM", version 1: channels, quality, both pairs of thresholds, the quality of each image,
// table.
std::string ColorModel::save() const {
  ByteWriter out;
  out.text(kColorMagic);
  out.u32(kColorVersion);
  out.u32(static_cast<std::uint32_t>(channels_.space));
  out.u32(static_cast<std::uint32_t>(channels_.set));
  for (const double value :
       {quality_.mean, quality_.deviation, flat_.low, flat_.high, weighted_.low, weighted_.high}) {
    out.f64(value);
  }
  out.u32(static_cast<std::uint32_t>(quality_.of_image.size()));
  for (const double value : quality_.of_image) out.f64(value);
  out.text({reinterpret_cast<const char*>(table_.data()), table_.size()});
  return out.sealed();
}

ColorModel ColorModel::load(std::string_view bytes) {
  ByteReader in(bytes, kColorMagic, kColorVersion, "color model");
  ColorModel model;
  model.channels_ = {static_cast<ColorSpace>(in.integer(0, static_cast<int>(ColorSpace::nrgb))),
                     static_cast<ChannelSet>(in.integer(0, static_cast<int>(ChannelSet::all)))};
  // r of (8.1) lies in [-2, 2].
  model.quality_.mean = in.f64(-2, 2);
  model.quality_.deviation = in.f64(0, 4);
  model.flat_ = load_thresholds(in);
  model.weighted_ = load_thresholds(in);
  const int count = in.integer(1, 1000000);
  for (int k = 0; k < count; ++k) model.quality_.of_image.push_back(in.f64(-2, 2));
  const std::string_view table = in.text(kTableSize);
  in.end();
  model.table_.resize(kTableSize);
  std::transform(table.begin(), table.end(), model.table_.begin(),
                 [](char c) { return static_cast<std::int8_t>(c); });
  return model;
}

}  // namespace vitreo::vision
