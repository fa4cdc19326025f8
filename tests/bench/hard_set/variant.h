// Variants of the hard set: what makes a sequence hard, one or two things at a time.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>

#include <string>
#include <vector>

namespace vitreo::hard_set {

/// What covers the robot, or hides it.
enum class Cover { none, third, half, full, tool, glare_passes, glare_stays, blood, bubbles };

struct Variant {
  std::string name;
  // the ground
  double drift_px = 0;        ///< per frame
  bool gray_vessels = false;  ///< vessels of the robot's own gray and darkness over the ground
  // the robot
  cv::Size2d semi_axes{30, 15};
  double speed = 1;      ///< of its way
  int absent_from = -1;  ///< frames [from, until) without a robot
  int absent_until = -1;
  double jump_px = 0;               ///< of the whole view, at frames 20, 40 and 60
  double zoom_to = 1;               ///< of the view, reached at the end
  cv::Vec3f tint{1.03F, 1, 0.97F};  ///< blue, green, red of its steel
  double shadow = 0.1;              ///< share of the light it takes beside it
  bool twin = false;                ///< a second robot alike, whose way crosses its own
  Cover cover = Cover::none;
  // the light
  double light = 1;
  cv::Vec3f cast{1, 1, 1};
  double flicker = 0.02;
  double vignette = 0.2;  ///< share of the light missing in the corners
  bool spot = false;      ///< an endoilluminator that wanders
  bool bands = false;     ///< of a lamp on mains before a rolling shutter
  bool reflexes = false;  ///< white, fixed in the image
  // the camera
  double defocus_px = 1.2;  ///< sigma of the blur
  int smear_px = 0;
  double noise = 2.5;  ///< gray levels at mid scale
  int jpeg = 0;        ///< quality; 0: not compressed
  bool gray = false;   ///< a camera without color
  // the training
  int training = 16;  ///< images with masks, of the plain variant before the same ground
};

/// All of them, in the order of the tables.
std::vector<Variant> all_variants();

}  // namespace vitreo::hard_set
