// Shape and reflectance of a body as the renderer draws it: an ellipsoid, two thin ones that cross,
// a cylinder with flat ends, or a rod or disc with round edges.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/sim/body.h"
#include "devices/sim/view.h"

#include <Eigen/Core>

#include <array>

namespace vitreo::sim {

/// Squared distance, in units of the body, beyond which no pixel is covered.
constexpr double kWellOutside = 1.3;

/// What is drawn of a body's two semi-axes: `cylinder` has flat ends and sharp rims; `rod` and
/// `disc` are rounded with the smaller semi-axis, as where they touch (support() in body.h).
enum class Solid { ellipsoid, cylinder, rod, disc };

/// Reflectance of a body's surface (Blinn's model) for a lamp that stands by the observer, a little
/// to one side.
struct BodyLook {
  double ambient = 0.06;                 // of all directions
  double diffuse = 0.16;                 // Lambert's, times the cosine to the lamp
  double specular = 0.35;                // of the highlight
  double shininess = 30;                 // exponent of the highlight
  std::array<double, 3> color{1, 1, 1};  // red, green, blue; of all that it reflects
  /// As the thesis' soft robots are: two elliptical plates that cross along the axis, in the planes
  /// of the body's side and across it. 0: the whole spheroid.
  double plate_thickness = 0;  // m
  double dot_pitch = 0;        // m: dark dots on a grid across the axis; 0: none
  Solid solid = Solid::ellipsoid;
};

/// The drawn shape: p.S p = 1 for one ellipsoid, or two thin ones that cross, p from the center; or
/// another solid about its axis. Frame of the view.
struct Figure {
  Eigen::Vector3d center;                 // m
  std::array<Eigen::Matrix3d, 2> shapes;  // S, 1/m^2
  int count = 1;
  Solid solid = Solid::ellipsoid;  // of the others `axis` and semi-axes count, and not `shapes`
  Eigen::Vector3d axis;            // unit
  double semi_axis = 0;            // m
  double semi_radius = 0;          // m
  // directions of the dots' grid
  Eigen::Vector3d side;
  Eigen::Vector3d across;
};

Figure figure_of(const View& view, const BodyState& body, const BodyLook& look);

/// m: how far a body reaches from its center along a unit vector.
double extent_along(const BodyState& body, const BodyLook& look, const Eigen::Vector3d& direction);

/// A pixel's line and a figure: the distance at which it passes the middle (1 at the rim), and the
/// point, from the center, at which it leaves the figure towards the observer, with its outward
/// normal.
struct Hit {
  double closest = 9 * 9;    // squared; far outside
  Eigen::Vector3d position;  // m
  Eigen::Vector3d normal;    // unit
};

Hit hit(const Figure& figure, const PixelLine& line);

}  // namespace vitreo::sim
