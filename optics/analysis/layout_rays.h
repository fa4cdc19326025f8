// Rays of a layout drawing: paths through all surfaces and fans of field points.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/rays/trace.h"
#include "optics/system/system.h"

#include <Eigen/Core>

#include <span>
#include <vector>

namespace vitreo::optics {

/// A ray as a polyline in the plane of the drawing: (z, height), m, eye frame. Rays of one group
/// share a color.
struct LayoutRay {
  std::vector<Eigen::Vector2d> path;
  int group = 0;
};

/// The path of a ray from the vitreous, through all surfaces, to the plane z = `end_z` (m); up to
/// where it is lost.
LayoutRay ray_path(const System& system, const Ray& ray, double end_z, int group = 0);

/// Fans of `count` rays that fill the stop, from the retina at each field angle (rad, at the stop's
/// center), or from `depth` (m) before it. Fields whose chief ray is lost are left out. Throws
/// std::invalid_argument without a stop.
std::vector<LayoutRay> field_fans(const System& system, std::span<const double> angles,
                                  double end_z, int count = 5, double depth = 0);

}  // namespace vitreo::optics
