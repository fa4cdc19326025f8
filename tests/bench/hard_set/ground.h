// Grounds of the hard set: retinas, generated and photographed, and other photographs, before which
// a tracker is judged.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>

#include <cstdint>
#include <string>
#include <vector>

namespace vitreo::hard_set {

constexpr int kGroundMargin = 200;  // px around the view, for its drift

struct Ground {
  std::string name;
  bool photograph = false;
  cv::Mat light;  ///< CV_32FC3, BGR in gray levels, the view's size and kGroundMargin all round
};

/// Generated: mottled tissue, three with vessels as dark as the robot around a disc, a choroid of
/// streaks, hemorrhages of about the robot's size.
std::vector<Ground> generated_grounds(std::uint64_t seed, const cv::Size& view);

/// From the folder of photographs that Debian's python3-skimage brings: three views of its fundus
/// (CC0), stained tissue, a cat's fur, a cup of coffee. Throws std::runtime_error where one is
/// missing.
std::vector<Ground> photographed_grounds(const std::string& folder, const cv::Size& view);

}  // namespace vitreo::hard_set
