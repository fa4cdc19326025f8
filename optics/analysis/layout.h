// Layout drawing of a system as SVG text: surfaces, tinted media, stop, rays, axis, scale.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/rays/trace.h"
#include "optics/system/system.h"

#include <Eigen/Core>

#include <span>
#include <string>
#include <vector>

namespace vitreo::optics {

/// A ray as a polyline in the plane of the drawing: (z, height), m, eye frame. Rays of one group
/// share a color.
struct LayoutRay {
  std::vector<Eigen::Vector2d> path;
  int group = 0;
};

/// A dashed line across the axis with a label, such as where the aerial image lies.
struct LayoutMark {
  double z = 0;               // m, eye frame
  double half_height = 4e-3;  // m
  std::string label;
};

struct LayoutOptions {
  std::string title;  // empty: the system's name
  std::vector<std::string>
      media;               // names of what lies behind each surface, for the legend; may be shorter
  double width_px = 1000;  // of the drawing; its height follows
  std::vector<LayoutMark> marks;
  void check() const;  // throws std::invalid_argument naming the option
};

/// SVG text without scripts, links or fonts of its own. Surfaces are drawn to their semi-diameters,
/// or where they have none as high as the rays need. Throws std::invalid_argument for an unsound
/// system, options, or rays not finite.
std::string layout_svg(const System& system, std::span<const LayoutRay> rays,
                       const LayoutOptions& options = {});

/// The way of a ray from the vitreous, through all surfaces, to the plane z = `end_z` (m); up to
/// where it is lost.
LayoutRay ray_path(const System& system, const Ray& ray, double end_z, int group = 0);

/// Fans of `count` rays that fill the stop, from the retina at each field angle (rad, at the stop's
/// center), or from `depth` (m) before it. Fields whose chief ray is lost are left out. Throws
/// std::invalid_argument without a stop.
std::vector<LayoutRay> field_fans(const System& system, std::span<const double> angles,
                                  double end_z, int count = 5, double depth = 0);

}  // namespace vitreo::optics
