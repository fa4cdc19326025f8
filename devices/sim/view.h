// View of a simulated camera: for each pixel one straight line in the fluid.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/projection/single_viewpoint.h"
#include "optics/rays/observer.h"

#include <Eigen/Core>

#include <optional>
#include <vector>

namespace vitreo::sim {

/// A pixel's line in the view frame: it passes (x, y, 0) and goes along (dx, dy, 1). NaN where
/// no light reaches the pixel.
struct PixelLine {
  float x;
  float y;
  float dx;
  float dy;
};

/// The lines of all pixels, row by row. The view frame's z points out of the eye towards the
/// observer.
struct View {
  int width = 0;   // px
  int height = 0;  // px
  std::vector<PixelLine> lines;
  Eigen::Matrix3d view_from_world = Eigen::Matrix3d::Identity();
  Eigen::Vector3d origin_in_world{0, 0, 0};  // m

  const PixelLine& at(int u, int v) const { return lines[static_cast<std::size_t>(v) * width + u]; }
  Eigen::Vector3d point_in_view(const Eigen::Vector3d& point_in_world) const {
    return view_from_world * (point_in_world - origin_in_world);
  }
  /// The pixel whose line passes a point of the view frame; nothing when none of the image does.
  std::optional<Eigen::Vector2d> pixel_of(const Eigen::Vector3d& point_in_view) const;
};

struct ImageSize {
  int width = 1384;   // px
  int height = 1036;  // px
};

/// Looks at the aerial image through a microscope: the isopixel lines, traced through the
/// prescription. Traced on a grid of `grid_step` pixels and interpolated by cubics in between,
/// which changes a line by less than 100 nm (tests hold it). `turn`: rad, of a camera that stands
/// turned about the axis of its object plane.
View eye_view(const optics::System& eye, const optics::Microscope& microscope,
              const optics::ImageScale& scale, const ImageSize& size,
              const Eigen::Vector3d& eye_in_world, int grid_step = 16, double turn = 0);

/// A bare sensor in the aerial image instead (thesis 4.1): nothing but the eye's own stop bounds
/// the light (in the plane of surface 2 where the eye has none). Returns the microscope whose chief
/// rays are the same: its pupil lies on the eye's side of the focus plane. `focus`: m, from the
/// last vertex to the sensor.
optics::Microscope bare_sensor(const optics::System& eye, double focus, double numerical_aperture);

/// Microscope without an eye below it: how it stands over the workspace. All 0: telecentric,
/// upright and focused on the plane z = 0.
struct PlainMicroscope {
  double pupil_power = 0;      // 1/m, 1 / the pupil's distance from the plane in focus
  Eigen::Vector2d tilt{0, 0};  // rad, about x then y, about the axis' point of that plane
  double plane = 0;            // m, height of the plane in focus
};

/// Looks down along -z without an eye: u along world x, v against world y, `pixel` m in the plane
/// in focus.
View plain_view(double pixel, const Eigen::Vector2d& center_px, const ImageSize& size,
                const PlainMicroscope& microscope = {});

/// Looks from the side along +y, orthographic: u along world x, v against world z; `pixel` in m.
/// `turn`: rad, of a camera that stands turned about its line of sight.
View side_view(double pixel, const Eigen::Vector2d& center_px, const ImageSize& size,
               double turn = 0);

}  // namespace vitreo::sim
