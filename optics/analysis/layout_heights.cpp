// SPDX-License-Identifier: Apache-2.0
#include "optics/analysis/layout_heights.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace vitreo::optics::detail {
namespace {

constexpr double kMargin = 1.2;    // beyond the outermost ray
constexpr double kOfRadius = 0.6;  // height of a surface that no ray meets
constexpr double kFlat = 4e-3;     // m, of a plane that no ray meets
constexpr double kNearEquator = 0.97;
constexpr double kThinnest = 0.04e-3;  // m, of what is left of a medium at the rim

/// A conic ends at its equator, r = R / sqrt(1 + k); one with k <= -1 does not end.
double reach(const Surface& surface) {
  const double bend = 1 + surface.conic;
  if (std::isinf(surface.radius) || bend <= 0) return std::numeric_limits<double>::infinity();
  return kNearEquator * std::abs(surface.radius) / std::sqrt(bend);
}

/// From the rays that meet the surface, else from its radius; a stop must fit on it.
/// The wanted height of surface i, counted from 0, m.
double wanted(const System& system, int i, std::span<const LayoutRay> rays) {
  const Surface& surface = system.surfaces[i];
  double height = 0;
  for (const LayoutRay& ray : rays) {
    if (ray.path.size() > static_cast<std::size_t>(i))
      height = std::max(height, std::abs(ray.path[i].y()));
  }
  height *= kMargin;
  if (height == 0)
    height = std::isinf(surface.radius) ? kFlat : kOfRadius * std::abs(surface.radius);
  if (system.stop && system.stop->surface == i + 1)
    height = std::max(height, 2 * system.stop->radius);
  return std::min(height, reach(surface));
}

/// Where the medium between two surfaces ends: their common height, or where they nearly meet.
/// Marched outwards instead of solved: two aspheres may cross several times, and the crossing
/// nearest the axis ends the medium.
double common_height(const Surface& front, const Surface& behind, double height) {
  constexpr int kSteps = 200;
  double good = 0;
  for (int i = 0; i <= kSteps; ++i) {
    const double r = height * i / kSteps;
    if (!(front.thickness + behind.sag(r) - front.sag(r) > kThinnest)) break;
    good = r;
  }
  return good;
}

}  // namespace

/// For a drawing only: heights decide nothing about rays.
std::vector<double> layout_heights(const System& system, std::span<const LayoutRay> rays) {
  const int count = system.size();
  std::vector<double> heights(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) heights[i] = wanted(system, i, rays);
  // The retina is drawn about as far out as the vitreous is long, where its sphere allows, so that
  // an eye looks like an eye.
  heights[0] =
      std::max(heights[0], std::min(reach(system.surfaces[0]), kNearEquator * system.vertex(2)));
  // Both sides of a lens are as high as the higher one; the humours between lenses are drawn as
  // they come. From the outside in, so that a cornea goes with the contact lens on it.
  for (int i = count - 2; i >= 1; --i) {
    const Surface& front = system.surfaces[i];
    const Surface& behind = system.surfaces[i + 1];
    const bool solid = front.index > system.surfaces[i - 1].index;
    if (!solid) continue;
    const double both =
        std::min({std::max(heights[i], heights[i + 1]), reach(front), reach(behind)});
    heights[i] = heights[i + 1] = common_height(front, behind, both);
  }
  // What is left of surfaces that cross: the lower one of the two is cut back to where the medium
  // ends.
  for (int i = 1; i + 1 < count; ++i) {
    if (system.surfaces[i].index == 1) continue;
    const double least = std::min(heights[i], heights[i + 1]);
    const double common = common_height(system.surfaces[i], system.surfaces[i + 1], least);
    if (common < least) heights[heights[i] < heights[i + 1] ? i : i + 1] = common;
  }
  // A prescribed rim outranks all estimates, but a conic still ends at its equator.
  for (int i = 1; i < count; ++i) {
    if (std::isfinite(system.surfaces[i].semi_diameter))
      heights[i] = std::min(system.surfaces[i].semi_diameter, reach(system.surfaces[i]));
  }
  return heights;
}

}  // namespace vitreo::optics::detail
