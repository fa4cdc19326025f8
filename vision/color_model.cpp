// SPDX-License-Identifier: Apache-2.0
#include "vision/color_model.h"

#include "vision/bytes.h"

#include <algorithm>

namespace vitreo::vision {
namespace {

constexpr std::string_view kColorMagic = "VTCM";
constexpr std::uint32_t kColorVersion = 1;
constexpr std::size_t kTableSize =
    static_cast<std::size_t>(ColorModel::kLevels) * ColorModel::kLevels * ColorModel::kLevels;

// F is within +-7.9 by the table's int8, so its thresholds are within +-8.
// A file whose numbers are out of range is refused as damaged, not clamped.
Thresholds load_thresholds(ByteReader& in) {
  Thresholds t;
  t.low = in.f64(-8, 8);
  t.high = in.f64(-8, 8);
  if (t.low > t.high) in.fail("its lower threshold is above the higher");
  return t;
}

}  // namespace

// Format "VTCM", version 1: channels, quality, both pairs of thresholds, the quality of each image,
// table.
// Little-endian, sealed by a checksum (bytes.h). u32 space, u32 channels; f64 mean and deviation of
// the quality, flat thresholds, weighted thresholds; u32 count and that many f64; 64^3 int8.
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

// Throws std::invalid_argument for bytes that save() did not write: each number is read with its
// bounds.
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
