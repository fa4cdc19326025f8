// TIFF stack: frames of one size and kind in one file, all pixels in one piece behind the head, as
// ImageJ reads them, then a directory a page (TIFF 6.0).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace vitreo {

struct TiffStack {
  int width_px = 0;
  int height_px = 0;
  int samples = 1;                  // a pixel: 1 gray, 3 RGB
  int bits = 8;                     // of a sample in the file: 8 or 16
  int significant_bits = 8;         // of a sample that count, the low ones
  double pixel = 0;                 // m of the observed plane; 0: not known
  std::string description;          // of the first page, for readers that know its form
  std::vector<std::string> labels;  // of the pages, UTF-8, as ImageJ shows them; or none
  std::uint64_t page_bytes() const;
};

/// How many pages fit into one file: its offsets have 32 bits.
std::size_t tiff_capacity(const TiffStack& stack);

/// Writes a new file; `pixels(i)` is page i, row by row, valid until the next call. Throws
/// std::runtime_error naming the file.
void write_tiff_stack(const std::filesystem::path& file, const TiffStack& stack, std::size_t pages,
                      const std::function<std::string_view(std::size_t)>& pixels);

}  // namespace vitreo
