// Conversion of a Zemax file to a prescription that begins at the retina.
// SPDX-License-Identifier: Apache-2.0
#include "optics/system/first_order.h"
#include "optics/system/zemax.h"

#include <cmath>
#include <limits>
#include <stdexcept>

namespace vitreo::optics {
namespace {

/// A surface met from the other side: radius and aspheric terms change their sign, the conic
/// constant does not.
Surface turned(Surface surface) {
  surface.radius = -surface.radius;
  for (double& a : surface.aspheric) a = -a;
  return surface;
}

/// Thickness and index belong to the gap behind a surface, so they move to the neighbor when the
/// order turns round.
std::vector<Surface> reversed(const std::vector<Surface>& forward) {
  std::vector<Surface> back;
  for (std::size_t i = forward.size(); i-- > 0;) {
    Surface surface = turned(forward[i]);
    surface.thickness = i > 0 ? forward[i - 1].thickness : 0;
    surface.index = i > 0 ? forward[i - 1].index : 1;
    back.push_back(surface);
  }
  return back;
}

/// Rays parallel to the axis at the entrance pupil's rim meet the rim of the stop, in first order.
/// What the beam in the file is defined by. Infinite semi-diameters, as rims have no part in first
/// order.
double stop_radius_from_pupil(const ZemaxFile& file) {
  System before;  // object space to the stop's plane
  before.surfaces.assign(file.surfaces.begin(), file.surfaces.begin() + file.stop + 1);
  // it may be infinite, and does not matter to parallel rays
  before.surfaces.front().thickness = 0;
  for (Surface& surface : before.surfaces)
    surface.semi_diameter = std::numeric_limits<double>::infinity();
  // Row (height), column (height) of the matrix (4.9): height at the stop per height of a ray that
  // enters parallel to the axis.
  return std::abs(system_matrix(before)(1, 1)) * *file.entrance_pupil_diameter / 2;
}

/// m. Nothing without a stop, and with one whose size the file does not tell.
std::optional<double> stop_radius(const ZemaxFile& file) {
  if (file.stop == 0) return std::nullopt;
  if (file.entrance_pupil_diameter)
    return stop_radius_from_pupil(file);  // what defines the beam in the file
  return file.stop_radius;
}

}  // namespace

/// The file's surface 0, or turned round its image surface, becomes surface 1, the retina; so file
/// surface i is number i + 1, or count - i. Throws std::invalid_argument naming the direction when
/// the retina would lie at infinity.
Prescription prescription_from_zemax(const ZemaxFile& file, ZemaxDirection direction) {
  const int count = static_cast<int>(file.surfaces.size());
  if (count < 3) throw std::invalid_argument("file: needs an object, a surface and an image");
  const bool turn = direction == ZemaxDirection::image_is_retina;
  Prescription made;
  made.name = "zemax";
  made.title = file.title.empty() ? "imported from Zemax" : file.title;
  made.source = "Zemax file; indices at the d line.";
  made.system.name = made.title;
  std::vector<Surface>& surfaces = made.system.surfaces;
  surfaces = turn ? reversed(file.surfaces) : file.surfaces;
  surfaces.pop_back();  // the far end: image plane or source, where nothing refracts
  surfaces.back().thickness = 0;
  if (std::isinf(surfaces.front().thickness)) {
    throw std::invalid_argument(
        "direction: the surface that should be the retina lies at infinity");
  }
  const auto radius = stop_radius(file);
  if (radius) made.system.stop = Stop{turn ? count - file.stop : file.stop + 1, *radius};
  for (int i = 1; i <= made.system.size(); ++i) {
    made.surfaces.push_back("surface_" + std::to_string(i));
    made.media.push_back("medium_" + std::to_string(i));
  }
  made.check();
  return made;
}

}  // namespace vitreo::optics
