// View watch: a camera's picture held against the empty scene that it has learnt: a camera that was
// knocked, turned or mirrored, or whose light or exposure changed, does not see that scene.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/background.h"

#include <opencv2/core/mat.hpp>

#include <string>
#include <vector>

namespace vitreo {

/// What it sees of a picture.
struct ViewChange {
  double changed = 0;          // part of the picture that is not the scene
  cv::Point2d shift_px{0, 0};  // by which the scene would have to move to be seen there
  double shift_sigma_px = 0;   // standard deviation of that, of the direction known worst
};

/// On a grid of some ten thousand pixels: the part that differs from the scene by more than noise,
/// and the scene's shift by least squares of one step (Lucas & Kanade 1981) over what does not.
class ViewWatch {
 public:
  explicit ViewWatch(const vision::Background& background);
  ViewChange look(const cv::Mat& gray) const;
  /// Why this is not the view that was learnt; empty where it is.
  std::string fault(const cv::Mat& gray) const;

 private:
  struct Point {
    int u = 0;
    int v = 0;
    float level = 0;
    float noise = 0;  // gray levels, standard deviation
    float du = 0;     // gray levels per px
    float dv = 0;
  };
  cv::Size size_;
  std::vector<Point> points_;
};

}  // namespace vitreo
