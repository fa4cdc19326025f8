// Bodies in the simulated eye: settings, state, drag, and contact with each other and the walls.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <array>
#include <string>

namespace vitreo::sim {

/// Pose and size of a body; `axis` is the axis of symmetry, along which the semi-axis is measured.
struct BodyState {
  Eigen::Vector3d position;       // m, world
  Eigen::Vector3d axis;           // unit
  double semi_axis;               // m
  double semi_radius;             // m
  Eigen::Vector3d side{0, 1, 0};  // unit, across the axis: turns with the body
};

/// Turns a body by the rotation vector `turn` (rad, world).
void turn_body(BodyState& body, const Eigen::Vector3d& turn);

enum class Shape { spheroid, disc, rod };  // disc and rod have round edges and ends

/// A body in the eye besides the robot.
struct BodySettings {
  std::string name;
  Shape shape = Shape::disc;
  double semi_axis = 0.1e-3;          // m; of a disc: half its thickness
  double semi_radius = 0.5e-3;        // m; of a disc: its radius
  Eigen::Vector3d position{0, 0, 0};  // m, world
  Eigen::Vector3d axis{0, 0, 1};
  double density = 1200;                        // kg/m^3
  bool fixed = false;                           // held from outside: a needle, a calibration target
  std::array<double, 3> color{0.8, 0.3, 0.25};  // reflectance in red, green and blue
  bool dotted = false;        // a calibration target: dark dots on a grid across its axis
  double dot_pitch = 0.5e-3;  // m, of that grid; the dots have half of it for their diameter
  void check() const;         // throws std::invalid_argument naming body and parameter
};

double volume_of(const BodySettings& body);  // m^3

/// Force per velocity, N s/m, along and across the axis, of a prolate or oblate spheroid (Perrin)
/// with these semi-axes.
struct SpheroidDrag {
  double along;   // N s/m
  double across;  // N s/m
};
SpheroidDrag spheroid_drag(double viscosity, double semi_axis, double semi_radius);

/// The point of the body farthest along a unit vector, from the body's center, m.
Eigen::Vector3d support(Shape shape, const BodyState& body, const Eigen::Vector3d& direction);

/// Overlap of two bodies.
struct Overlap {
  Eigen::Vector3d normal{0, 0, 1};  // unit, from the first to the second
  double depth = 0;                 // m; 0: they do not touch
};
Overlap overlap(Shape first_shape, const BodyState& first, Shape second_shape,
                const BodyState& second);

/// The cavity: a sphere of retina, a cylinder above its equator, and the lens as a lid. World
/// frame, m.
struct Cavity {
  Eigen::Vector3d vertex{0, 0, -5e-3};  // of the retina
  double radius = 11.5e-3;
  double lens_depth = 15.5e-3;  // from the vertex to the lens
  void check() const;           // throws std::invalid_argument naming the parameter
  /// The wall at the side or below: unit normal towards a point, and the point's distance from it,
  /// m (negative outside).
  struct Wall {
    Eigen::Vector3d normal;
    double distance;
  };
  Wall retina(const Eigen::Vector3d& point) const;
  /// m from the lens' plane down to a point, negative above it.
  double below_lens(const Eigen::Vector3d& point) const {
    return vertex.z() + lens_depth - point.z();
  }
};

/// Puts a body back inside; friction takes from the sliding of the point of contact, turning
/// included. `before`: the body's position (m) at the step's start; `turned`: its rotation vector
/// since, rad. Returns whether it touches the retina.
bool keep_inside(const Cavity& cavity, Shape shape, double friction, const Eigen::Vector3d& before,
                 const Eigen::Vector3d& turned, BodyState& body);

}  // namespace vitreo::sim
