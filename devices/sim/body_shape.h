// A body as the renderer meets it: one ellipsoid, or two thin ones that cross, in the frame of a
// view.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/sim/renderer.h"

#include <Eigen/Core>

#include <array>

namespace vitreo::sim {

constexpr double kWellOutside =
    1.3;  // squared distance, in units of the body, beyond which no pixel is touched

/// What a body is drawn as: an ellipsoid, or two thin ones that cross; frame of the view.
struct Figure {
  Eigen::Vector3d center;
  std::array<Eigen::Matrix3d, 2> shapes;
  int count = 1;
  Eigen::Vector3d side, across;  // directions of the dots' grid
};

Figure figure_of(const View& view, const BodyState& body, const BodyLook& look);

/// Shortest and nearest: how far a pixel's line passes from the figure (1 at its rim) and where it
/// leaves it towards us.
struct Hit {
  double closest = 9 * 9;  // squared
  Eigen::Vector3d place, normal;
};

Hit hit(const Figure& figure, const PixelLine& line);

}  // namespace vitreo::sim
