// Helical swimmer: its geometry, and its resistance by resistive force theory.
// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace vitreo::control {

/// A rigid filament wound about the robot's axis, with a magnet in the middle that is magnetized
/// across the axis. Fluid dynamics take the magnet for a sphere.
struct Helix {
  double radius = 0.2e-3;          // m, from the axis to the filament's middle line
  double pitch = 1e-3;             // m, along the axis, of one turn
  double turns = 2;                // whole ones: the filament is balanced about the axis
  double filament_radius = 30e-6;  // m
  double head_radius = 0.15e-3;    // m, of the sphere
  bool left_handed = false;
  double length() const { return turns * pitch; }  // m, along the axis
  void check() const;                              // throws std::invalid_argument
  /// All lengths times `factor`.
  Helix scaled(double factor) const;
};

/// Along the axis [F; T] = [along, coupling; coupling, spin] [v; w] (Purcell 1997), and across it
/// the same with across, coupling_across and turning, means over the roll.
struct HelixResistance {
  double along = 0;            // N s/m
  double coupling = 0;         // N s: negative for a right-handed helix, which screws forwards
  double spin = 0;             // N m s
  double across = 0;           // N s/m
  double coupling_across = 0;  // N s
  double turning = 0;          // N m s
  /// m/rad: v / w of a helix on which no force acts.
  double advance() const { return -coupling / along; }
  /// N m s: torque over w of a helix on which no force acts.
  double free_spin() const { return spin - coupling * coupling / along; }
  /// m/rad, and N m s: the same across the axis.
  double advance_across() const { return -coupling_across / across; }
  double free_turning() const { return turning - coupling_across * coupling_across / across; }
};

/// Local drag of the filament by Gray and Hancock's coefficients (1955) with the pitch as their
/// wavelength, and Stokes' of the sphere. `viscosity` in Pa s. Known to be within a factor of two
/// of experiments (Rodenborn et al. 2013). Throws std::invalid_argument naming a parameter.
HelixResistance helix_resistance(const Helix& helix, double viscosity);

}  // namespace vitreo::control
