// SPDX-License-Identifier: Apache-2.0
#include "vision/color_space.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo::vision {
namespace {

using Triple = std::array<double, 3>;

constexpr std::array kSpaces{ColorSpace::rgb, ColorSpace::yuv, ColorSpace::yiq,
                             ColorSpace::hsv, ColorSpace::xyz, ColorSpace::nrgb};

// The channels' letters as in table 8.2.
// The names of channels, such as RG or HS, are made of these.
std::array<std::string, 3> letters_of(ColorSpace space) {
  switch (space) {
    case ColorSpace::rgb:
      return {"R", "G", "B"};
    case ColorSpace::yuv:
      return {"Y", "U", "V"};
    case ColorSpace::yiq:
      return {"Y", "I", "Q"};
    case ColorSpace::hsv:
      return {"H", "S", "V"};
    case ColorSpace::xyz:
      return {"X", "Y", "Z"};
    case ColorSpace::nrgb:
      break;
  }
  return {"nR", "nG", "nB"};
}

// Hexcone model (Smith 1978). The hue of gray is undefined, taken as 0; red sits at both ends.
// All three in [0, 1].
Triple hsv(double r, double g, double b) {
  const double high = std::max({r, g, b});
  const double low = std::min({r, g, b});
  const double spread = high - low;
  if (spread <= 0) return {0, 0, high};
  double hue = 0;  // sixths of a turn
  if (high == r) {
    hue = (g - b) / spread;
  } else if (high == g) {
    hue = 2 + (b - r) / spread;
  } else {
    hue = 4 + (r - g) / spread;
  }
  return {(hue < 0 ? hue + 6 : hue) / 6, spread / high, high};
}

// Y' of ITU-R BT.601.
double luma(double r, double g, double b) { return 0.299 * r + 0.587 * g + 0.114 * b; }

// BT.601 color differences, scaled to [0, 1] as Cb and Cr: B - Y reaches +-(1 - 0.114) = 0.886, R -
// Y reaches +-(1 - 0.299) = 0.701.
Triple yuv(double r, double g, double b) {
  const double y = luma(r, g, b);
  return {y, 0.5 + (b - y) / (2 * 0.886), 0.5 + (r - y) / (2 * 0.701)};
}

// NTSC 1953: I reaches +-0.596 and Q +-0.523, from which they are scaled to [0, 1].
Triple yiq(double r, double g, double b) {
  const double i = 0.596 * r - 0.274 * g - 0.322 * b;
  const double q = 0.211 * r - 0.523 * g + 0.312 * b;
  return {luma(r, g, b), 0.5 + i / (2 * 0.596), 0.5 + q / (2 * 0.523)};
}

// CIE XYZ of sRGB primaries, each divided by its white point (D65: 0.9505, 1, 1.0887). Applied to
// the camera's values as they are, without sRGB's transfer function.
Triple xyz(double r, double g, double b) {
  return {(0.4125 * r + 0.3576 * g + 0.1804 * b) / 0.9505, 0.2127 * r + 0.7152 * g + 0.0722 * b,
          (0.0193 * r + 0.1192 * g + 0.9502 * b) / 1.0887};
}

// Chromaticities r / (r + g + b) and so on; black is taken as gray.
Triple nrgb(double r, double g, double b) {
  const double sum = r + g + b;
  return sum > 0 ? Triple{r / sum, g / sum, b / sum} : Triple{1.0 / 3, 1.0 / 3, 1.0 / 3};
}

}  // namespace

std::vector<int> indices_of(ChannelSet set) {
  switch (set) {
    case ChannelSet::first_second:
      return {0, 1};
    case ChannelSet::second_third:
      return {1, 2};
    case ChannelSet::first_third:
      return {0, 2};
    case ChannelSet::all:
      break;
  }
  return {0, 1, 2};
}

// A name that channels_of reads back.
std::string name_of(const Channels& channels) {
  const auto letters = letters_of(channels.space);
  std::string name;
  for (const int k : indices_of(channels.set)) name += letters[static_cast<std::size_t>(k)];
  return name;
}

// Three pairs for each of the six spaces; a pair is what the thesis trains, all three channels cost
// no more here.
std::vector<Channels> all_pairs() {
  std::vector<Channels> pairs;
  for (const ColorSpace space : kSpaces) {
    for (const ChannelSet set :
         {ChannelSet::first_second, ChannelSet::second_third, ChannelSet::first_third}) {
      pairs.push_back({space, set});
    }
  }
  return pairs;
}

// Throws std::invalid_argument listing the names.
Channels channels_of(const std::string& name) {
  std::vector<Channels> offered = all_pairs();
  for (const ColorSpace space : kSpaces) offered.push_back({space, ChannelSet::all});
  std::string names;
  for (const Channels& c : offered) {
    if (name_of(c) == name) return c;
    names += " " + name_of(c);
  }
  throw std::invalid_argument("channels: '" + name + "' is none of" + names);
}

// r, g, b in [0, 1]; each result in [0, 1] too, so that one histogram serves every space.
std::array<double, 3> convert(ColorSpace space, double r, double g, double b) {
  switch (space) {
    case ColorSpace::rgb:
      return {r, g, b};
    case ColorSpace::yuv:
      return yuv(r, g, b);
    case ColorSpace::yiq:
      return yiq(r, g, b);
    case ColorSpace::hsv:
      return hsv(r, g, b);
    case ColorSpace::xyz:
      return xyz(r, g, b);
    case ColorSpace::nrgb:
      break;
  }
  return nrgb(r, g, b);
}

}  // namespace vitreo::vision
