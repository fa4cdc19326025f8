// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/genicam/pixels.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cstring>
#include <stdexcept>

namespace vitreo::genicam {
namespace {

/// Bits that a pixel takes on the wire, its gaps included.
int wire_bits(const PixelFormat& format) {
  if (format.packing == Packing::gige_packed) return 12;
  if (format.packing == Packing::dense) return format.bits;
  return format.channels * (format.bits > 8 ? 16 : 8);
}

/// Gray or mosaic of more than 8 bits a pixel, right-aligned.
cv::Mat unpack(const PixelFormat& format, std::span<const std::uint8_t> bytes, int width,
               int height) {
  cv::Mat deep(height, width, CV_16U);
  const std::size_t count = deep.total();
  auto* const pixels = deep.ptr<std::uint16_t>();
  if (format.packing == Packing::gige_packed) {
    // Three bytes hold two pixels: high bits of A; low bits of A in the low nibble and of B in the
    // high one; high bits of B.
    const int low = format.bits - 8;
    const int mask = (1 << low) - 1;
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t at = i / 2 * 3;
      const int high = bytes[i % 2 == 0 ? at : at + 2];
      const int nibble = i % 2 == 0 ? bytes[at + 1] & 0xF : bytes[at + 1] >> 4;
      pixels[i] = static_cast<std::uint16_t>(high << low | (nibble & mask));
    }
    return deep;
  }
  if (format.packing == Packing::dense) {
    const unsigned mask = (1U << format.bits) - 1;
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t bit = i * static_cast<std::size_t>(format.bits);
      unsigned word = bytes[bit / 8];
      if (bit / 8 + 1 < bytes.size()) word |= unsigned{bytes[bit / 8 + 1]} << 8;
      if (bit / 8 + 2 < bytes.size()) word |= unsigned{bytes[bit / 8 + 2]} << 16;
      pixels[i] = static_cast<std::uint16_t>(word >> bit % 8 & mask);
    }
    return deep;
  }
  for (std::size_t i = 0; i < count; ++i)
    pixels[i] = static_cast<std::uint16_t>(bytes[2 * i] | bytes[2 * i + 1] << 8);
  return deep;
}

/// OpenCV's name of a mosaic whose first row begins so.
int conversion_of(const std::string& pattern) {
  if (pattern == "RG") return cv::COLOR_BayerRGGB2BGR;
  if (pattern == "GR") return cv::COLOR_BayerGRBG2BGR;
  if (pattern == "GB") return cv::COLOR_BayerGBRG2BGR;
  return cv::COLOR_BayerBGGR2BGR;
}

std::vector<PixelFormat> all_formats() {
  std::vector<PixelFormat> formats = {{"Mono8", 0x01080001},
                                      {"Mono10", 0x01100003, 10},
                                      {"Mono12", 0x01100005, 12},
                                      {"Mono14", 0x01100025, 14},
                                      {"Mono16", 0x01100007, 16},
                                      {"Mono10p", 0x010A0046, 10, Packing::dense},
                                      {"Mono12p", 0x010C0047, 12, Packing::dense},
                                      {"Mono10Packed", 0x010C0004, 10, Packing::gige_packed},
                                      {"Mono12Packed", 0x010C0006, 12, Packing::gige_packed},
                                      {"RGB8", 0x02180014, 8, Packing::bytes, 3},
                                      {"BGR8", 0x02180015, 8, Packing::bytes, 3, "", true}};
  // The four phases follow each other: GR, RG, GB, BG.
  const auto add = [&formats](std::uint32_t first, int bits, const std::string& suffix) {
    for (const char* const pattern : {"GR", "RG", "GB", "BG"})
      formats.push_back(
          {std::string("Bayer") + pattern + suffix, first++, bits, Packing::bytes, 1, pattern});
  };
  add(0x01080008, 8, "8");
  add(0x0110000C, 10, "10");
  add(0x01100010, 12, "12");
  add(0x0110002E, 16, "16");
  const auto add_dense = [&formats](std::uint32_t first, int bits, const std::string& suffix) {
    for (const char* const pattern : {"BG", "GB", "GR", "RG"}) {
      formats.push_back(
          {std::string("Bayer") + pattern + suffix, first, bits, Packing::dense, 1, pattern});
      first += 2;
    }
  };
  add_dense(0x010A0052, 10, "10p");
  add_dense(0x010C0053, 12, "12p");
  return formats;
}

}  // namespace

const std::vector<PixelFormat>& pixel_formats() {
  static const std::vector<PixelFormat> formats = all_formats();
  return formats;
}

const PixelFormat* format_of(std::uint32_t code) {
  const auto& all = pixel_formats();
  const auto found =
      std::find_if(all.begin(), all.end(), [&](const PixelFormat& f) { return f.code == code; });
  return found == all.end() ? nullptr : &*found;
}

const PixelFormat* format_of(const std::string& name) {
  const auto& all = pixel_formats();
  const auto found =
      std::find_if(all.begin(), all.end(), [&](const PixelFormat& f) { return f.name == name; });
  return found == all.end() ? nullptr : &*found;
}

std::size_t bytes_of(const PixelFormat& format, int width_px, int height_px) {
  const std::size_t pixels =
      static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px);
  return (pixels * static_cast<std::size_t>(wire_bits(format)) + 7) / 8;
}

Pixels decode(const PixelFormat& format, std::span<const std::uint8_t> bytes, int width_px,
              int height_px) {
  if (bytes.size() < bytes_of(format, width_px, height_px))
    throw std::invalid_argument(format.name + ": " + std::to_string(bytes.size()) +
                                " bytes are too few for the image");
  Pixels out;
  cv::Mat mosaic;  // or gray, of 8 bits
  if (format.bits > 8) {
    const cv::Mat deep = unpack(format, bytes, width_px, height_px);
    deep.convertTo(mosaic, CV_8U, 255.0 / ((1 << format.bits) - 1));
    if (format.pattern.empty()) out.deep = deep;
  } else {
    mosaic.create(height_px, width_px, CV_8UC(format.channels));
    std::memcpy(mosaic.data, bytes.data(), mosaic.total() * mosaic.elemSize());
  }
  if (!format.pattern.empty())
    cv::cvtColor(mosaic, out.image, conversion_of(format.pattern));
  else if (format.channels == 3 && !format.blue_first)
    cv::cvtColor(mosaic, out.image, cv::COLOR_RGB2BGR);
  else
    out.image = mosaic;
  return out;
}

}  // namespace vitreo::genicam
