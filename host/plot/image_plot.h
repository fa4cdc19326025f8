// Image plot: an image with lines, points and ellipses over it, as self-contained SVG for the
// report and as a file.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/plot/plot.h"
#include "vision/ellipse.h"

#include <opencv2/core/mat.hpp>

#include <string>
#include <vector>

namespace vitreo {

struct ImagePlot {
  std::string title;
  cv::Mat image;              // 8-bit gray or BGR; kept as JPEG
  std::vector<Series> marks;  // in px: the first pixel's center is (0, 0), x right, y down
  double scale_bar_px = 0;    // 0: none
  std::string scale_bar_label;
  std::string note;  // one line below
};

/// Its outline as a closed line.
Series outline(const std::string& label, const vision::Ellipse& ellipse, Mark mark = Mark::line);

/// With axes in px and a legend beside; what sticks out of the image is cut. Throws
/// std::invalid_argument for an image that is empty or not 8-bit gray or BGR, and for marks of
/// unequal length.
std::string to_svg(const ImagePlot& plot);

}  // namespace vitreo
