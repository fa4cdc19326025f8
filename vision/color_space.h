// Color spaces of thesis table 8.2, and the subset of channels that a model uses.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <string>
#include <vector>

namespace vitreo::vision {

enum class ColorSpace { rgb, yuv, yiq, hsv, xyz, nrgb };
/// Which of a space's three channels; the pairs stand in the order of table 8.2's columns.
enum class ChannelSet { first_second, second_third, first_third, all };

struct Channels {
  ColorSpace space = ColorSpace::rgb;
  ChannelSet set = ChannelSet::all;
  bool operator==(const Channels&) const = default;
};

/// "RG", "YV", "HS", "RGB"; for nRGB "nRnG".
std::string name_of(const Channels& channels);
/// The reverse of name_of. Throws std::invalid_argument naming what is offered instead.
Channels channels_of(const std::string& name);
/// The eighteen pairs of table 8.2, row by row.
std::vector<Channels> all_pairs();
/// Indices of the channels used, 2 or 3 of them.
std::vector<int> indices_of(ChannelSet set);
/// The three channels of `space`, each scaled to [0, 1]; r, g, b in [0, 1], as the camera gives
/// them: no gamma is applied or removed. Matrices: ITU-R BT.601 (YUV), NTSC 1953 (YIQ), sRGB with
/// D65 (XYZ).
std::array<double, 3> convert(ColorSpace space, double r, double g, double b);

}  // namespace vitreo::vision
