// Clearance: distance of a body's surface from the retina and the lens, with its uncertainty.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/robot.h"

#include <Eigen/Core>

#include <limits>

namespace vitreo::control {

/// A body's surface for the clearance: round about its axis. Crossed plates count as the hull of
/// all their rolls about the axis, which nothing measures: the ellipsoid of their outline.
struct BodySurface {
  BodyShape shape = BodyShape::ellipsoid;
  double semi_axis = 1e-3;      // m, along the axis; of a disc: half its thickness
  double semi_radius = 0.5e-3;  // m, across
  void check() const;           // throws std::invalid_argument naming the parameter
  /// The farthest that the body reaches from its center along a unit vector that makes an angle
  /// with its axis, m: the support function, of |cos(angle)|.
  double reach(double cosine) const;
};

BodySurface surface_of(const Robot& robot);

/// Inside of the eye, world frame, m: the retina's sphere, a cylinder of the same radius above its
/// equator, and the plane of the lens' rear vertex for a lid. The lens bulges towards the retina,
/// so the plane is nowhere beyond it.
struct EyeCavity {
  Eigen::Vector3d vertex{0, 0, -5e-3};  // of the retina
  double radius = 11.5e-3;
  double lens_depth = 15.5e-3;  // from the vertex to the lens
  // m, standard deviations of where the walls are: the retina along z and by its sag 4 mm from the
  // axis, the lens along z.
  double retina_sigma = 0;
  double sag_sigma = 0;
  double lens_sigma = 0;
  void check() const;  // throws std::invalid_argument naming the parameter
};

/// Position and attitude of a body, and what is not known of them.
struct UncertainPose {
  Eigen::Vector3d position{0, 0, 0};                     // m, world
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  // m^2, of all that is not known
  Eigen::Vector3d axis{1, 0, 0};                         // unit
  /// rad, standard deviation of the axis; infinite: any attitude.
  double axis_sigma = std::numeric_limits<double>::infinity();
};

/// Of one wall.
struct WallClearance {
  double distance = 0;              // m, surface to wall; negative: inside the wall
  Eigen::Vector3d normal{0, 0, 1};  // unit, away from the wall: moving along it gains distance
  double uncertainty = 0;           // m, half width of the 99 % interval
  double bound() const { return distance - uncertainty; }  // m, its lower end
};

struct Clearance {
  WallClearance retina;
  WallClearance lens;
  bool at_lens() const { return lens.bound() < retina.bound(); }
  const WallClearance& nearest() const { return at_lens() ? lens : retina; }
};

/// Distance of the surface, and U = 0.38 d + hypot(2.58 sqrt(n' P n), 0.62 d): P is the position's
/// covariance with the wall's own place in it, n the normal at the nearest point, d how much nearer
/// the body is when its axis is off by up to 3.26 axis_sigma (99.5 % of the tilts) in the worst
/// direction: what lies flat can only come nearer by it, by 0.38 d in the mean. One in two hundred
/// is nearer than the bound. Throws std::invalid_argument for values that are not finite.
Clearance clearance(const BodySurface& body, const EyeCavity& eye, const UncertainPose& pose);

}  // namespace vitreo::control
