// Conversion of a Zemax file to a prescription that begins at the retina.
// SPDX-License-Identifier: Apache-2.0
#include "optics/system/first_order.h"
#include "optics/system/zemax.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace vitreo::optics {
namespace {

/// A surface met from the other side: radius and aspheric terms change their sign, the conic
/// constant does not.
Surface turned(Surface surface) {
  surface.radius = -surface.radius;
  surface.radius_y = -surface.radius_y;
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

/// The surfaces of a file without its coordinate breaks, and where they stand.
struct Unbroken {
  std::vector<Surface> surfaces;
  std::vector<SurfaceFrame> frames;  // in the frame of the file's surface 1
  int stop = 0;                      // from 0, as in the file; 0: none
  bool straight = true;              // without any break
};

Eigen::Matrix3d about(int axis, double angle) {
  return Eigen::AngleAxisd(angle, Eigen::Vector3d::Unit(axis)).toRotationMatrix();
}

SurfaceFrame behind(const SurfaceFrame& before, const ZemaxBreak& at) {
  const Eigen::Matrix3d x = about(0, at.tilt.x());
  const Eigen::Matrix3d y = about(1, at.tilt.y());
  const Eigen::Matrix3d z = about(2, at.tilt.z());
  const Eigen::Vector3d moved(at.decenter.x(), at.decenter.y(), 0);
  const Eigen::Matrix3d turn = at.tilt_first ? Eigen::Matrix3d(z * y * x) : x * y * z;
  return {before.axes * turn, before.origin + before.axes * (at.tilt_first ? turn * moved : moved)};
}

/// Walks along the file's current axes. An object at infinity stands at the first surface: what is
/// there does not matter.
Unbroken unbroken(const ZemaxFile& file) {
  Unbroken made;
  SurfaceFrame at;
  for (std::size_t i = 0; i < file.surfaces.size(); ++i) {
    const Surface& surface = file.surfaces[i];
    if (i < file.breaks.size() && file.breaks[i]) {
      at = behind(at, *file.breaks[i]);
      made.straight = false;
      // The medium goes on; only the way along the axes is longer.
      if (std::isfinite(made.surfaces.back().thickness))
        made.surfaces.back().thickness += surface.thickness;
    } else {
      if (file.stop == static_cast<int>(i)) made.stop = static_cast<int>(made.surfaces.size());
      made.surfaces.push_back(surface);
      made.frames.push_back(at);
    }
    if (std::isfinite(surface.thickness))
      at.origin += at.axes * Eigen::Vector3d(0, 0, surface.thickness);
  }
  return made;
}

/// Puts the surfaces where the file's breaks have put them, in the frame of the retina. Turned
/// round, all axes turn by pi about y, so that light that leaves the eye goes along +z.
void place(std::vector<Surface>& surfaces, std::vector<SurfaceFrame> frames, bool turn) {
  constexpr double kRounding = 1e-15;  // m and rad
  if (turn) std::reverse(frames.begin(), frames.end());
  const Eigen::Matrix3d around =
      turn ? Eigen::Vector3d(-1, 1, -1).asDiagonal().toDenseMatrix() : Eigen::Matrix3d::Identity();
  const SurfaceFrame retina = frames.front();
  double vertex = 0;
  for (std::size_t i = 0; i < surfaces.size(); ++i) {
    const Eigen::Vector3d origin = around * retina.to_local(frames[i].origin);
    const Eigen::Matrix3d axes = around * retina.axes.transpose() * frames[i].axes * around;
    if (i > 0) {
      surfaces[i - 1].thickness = std::max(0.0, origin.z() - vertex);
      vertex += surfaces[i - 1].thickness;
    }
    Placement& placed = surfaces[i].placement;
    placed = {origin - Eigen::Vector3d(0, 0, vertex), tilt_of(axes)};
    placed.decenter = (placed.decenter.array().abs() < kRounding).select(0, placed.decenter);
    placed.tilt = (placed.tilt.array().abs() < kRounding).select(0, placed.tilt);
  }
}

/// Rays parallel to the axis at the entrance pupil's rim meet the rim of the stop, in first order.
/// What the beam in the file is defined by. Infinite semi-diameters, as rims have no part in first
/// order.
double stop_radius_from_pupil(const ZemaxFile& file, const Unbroken& lens) {
  System before;  // object space to the stop's plane
  before.surfaces.assign(lens.surfaces.begin(), lens.surfaces.begin() + lens.stop + 1);
  // it may be infinite, and does not matter to parallel rays
  before.surfaces.front().thickness = 0;
  for (Surface& surface : before.surfaces)
    surface.semi_diameter = std::numeric_limits<double>::infinity();
  // Row (height), column (height) of the matrix (4.9): height at the stop per height of a ray that
  // enters parallel to the axis.
  return std::abs(system_matrix(before)(1, 1)) * *file.entrance_pupil_diameter / 2;
}

/// m. Nothing without a stop, and with one whose size the file does not tell.
std::optional<double> stop_radius(const ZemaxFile& file, const Unbroken& lens) {
  if (lens.stop == 0) return std::nullopt;
  if (file.entrance_pupil_diameter)
    return stop_radius_from_pupil(file, lens);  // what defines the beam in the file
  return file.stop_radius;
}

}  // namespace

/// The file's surface 0, or turned round its image surface, becomes surface 1, the retina; so file
/// surface i is number i + 1, or count - i. Throws std::invalid_argument naming the direction when
/// the retina would lie at infinity.
Prescription prescription_from_zemax(const ZemaxFile& file, ZemaxDirection direction) {
  const Unbroken lens = unbroken(file);
  const int count = static_cast<int>(lens.surfaces.size());
  if (count < 3) throw std::invalid_argument("file: needs an object, a surface and an image");
  const bool turn = direction == ZemaxDirection::image_is_retina;
  Prescription made;
  made.name = "zemax";
  made.title = file.title.empty() ? "imported from Zemax" : file.title;
  made.source = "Zemax file; indices at the d line.";
  made.system.name = made.title;
  std::vector<Surface>& surfaces = made.system.surfaces;
  surfaces = turn ? reversed(lens.surfaces) : lens.surfaces;
  surfaces.pop_back();  // the far end: image plane or source, where nothing refracts
  surfaces.back().thickness = 0;
  if (std::isinf(surfaces.front().thickness)) {
    throw std::invalid_argument(
        "direction: the surface that should be the retina lies at infinity");
  }
  if (!lens.straight) place(surfaces, lens.frames, turn);
  const auto radius = stop_radius(file, lens);
  if (radius) made.system.stop = Stop{turn ? count - lens.stop : lens.stop + 1, *radius};
  for (int i = 1; i <= made.system.size(); ++i) {
    made.surfaces.push_back("surface_" + std::to_string(i));
    made.media.push_back("medium_" + std::to_string(i));
  }
  made.check();
  return made;
}

}  // namespace vitreo::optics
