// Pixel formats of GenICam's naming convention (PFNC 2.4, EMVA): from the bytes of a buffer to
// images.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace vitreo::genicam {

/// How the bits of a pixel lie in the bytes.
enum class Packing {
  bytes,       ///< 8 bits, or 16 of which the low ones count, little-endian
  dense,       ///< Mono10p, Mono12p: without gaps, the low bits first
  gige_packed  ///< Mono10Packed, Mono12Packed of GigE Vision 1: high bytes of two, their low bits
               ///< between
};

struct PixelFormat {
  std::string name;        ///< as the camera's PixelFormat has it
  std::uint32_t code = 0;  ///< PFNC's
  int bits = 8;            ///< that count, of a pixel
  Packing packing = Packing::bytes;
  int channels = 1;
  std::string pattern{};  ///< of a Bayer mosaic, its first two pixels: "RG", "GR", "GB", "BG"
  bool blue_first = false;
};

/// Those that this host knows.
const std::vector<PixelFormat>& pixel_formats();
/// Null where it is not known.
const PixelFormat* format_of(std::uint32_t code);
const PixelFormat* format_of(const std::string& name);

/// Bytes of an image without padding.
std::size_t bytes_of(const PixelFormat& format, int width_px, int height_px);

struct Pixels {
  cv::Mat image;  ///< CV_8UC1, or CV_8UC3 in blue, green, red
  cv::Mat deep;   ///< CV_16UC1 of a gray image of more than 8 bits, right-aligned; else empty
};
/// `bytes` has at least bytes_of(): std::invalid_argument. A mosaic becomes color (bilinear).
/// The largest number of the format becomes 255. All of it is a copy.
Pixels decode(const PixelFormat& format, std::span<const std::uint8_t> bytes, int width_px,
              int height_px);

}  // namespace vitreo::genicam
