// Layout drawing of a system as SVG text: surfaces, tinted media, stop, rays, axis, scale.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/analysis/layout_rays.h"
#include "optics/system/system.h"

#include <span>
#include <string>
#include <vector>

namespace vitreo::optics {

/// A dashed line across the axis with a label, such as where the aerial image lies.
struct LayoutMark {
  double z = 0;               // m, eye frame
  double half_height = 4e-3;  // m
  std::string label;
};

struct LayoutOptions {
  std::string title;  // empty: the system's name
  // names of what lies behind each surface, for the legend; may be shorter
  std::vector<std::string> media;
  double width_px = 1000;  // of the drawing; its height follows
  std::vector<LayoutMark> marks;
  void check() const;  // throws std::invalid_argument naming the option
};

/// SVG text without scripts, links or fonts of its own. Surfaces are drawn to their semi-diameters,
/// or where they have none as high as the rays need. Throws std::invalid_argument for an unsound
/// system, options, or rays not finite.
std::string layout_svg(const System& system, std::span<const LayoutRay> rays,
                       const LayoutOptions& options = {});

}  // namespace vitreo::optics
