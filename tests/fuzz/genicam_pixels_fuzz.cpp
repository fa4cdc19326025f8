// Buffers of a GenICam camera: any bytes, under each format, of any small size.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/genicam/pixels.h"

#include <cstdlib>
#include <stdexcept>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace vitreo::genicam;
  if (size < 3) return 0;
  const PixelFormat& format = pixel_formats()[data[0] % pixel_formats().size()];
  const int width = 2 + data[1] % 64;
  const int height = 2 + data[2] % 64;
  try {
    const Pixels pixels = decode(format, {data + 3, size - 3}, width, height);
    if (pixels.image.cols != width || pixels.image.rows != height) std::abort();
    if (bytes_of(format, width, height) > size - 3) std::abort();
  } catch (const std::invalid_argument&) {
    if (bytes_of(format, width, height) <= size - 3) std::abort();
  }
  return 0;
}
