// Raw film: uncompressed frames with their times as a Matroska stream (RFC 9559), which other
// programs read from a pipe.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace vitreo {

/// Rows without gaps; bgr: 8 bits a color.
enum class RawPixels { gray8, gray16, bgr8 };

/// What comes before the first frame.
std::string raw_film_head(int width_px, int height_px, RawPixels pixels);
/// What comes before a frame's `bytes` pixels. `time_us`: from 0.
std::string raw_film_frame_head(std::uint64_t time_us, std::uint64_t bytes);

}  // namespace vitreo
