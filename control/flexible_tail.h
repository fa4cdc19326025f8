// Flexible tail: an elastic filament behind a magnetic head, its drag and its bending.
// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace vitreo::control {

/// A straight elastic filament that is clamped to a spherical head. The moment of the head's magnet
/// lies along the robot's axis, from the tail to the head. The robot's position is the straight
/// body's center of reaction: a torque turns the body about it, a force there does not turn it.
struct FlexibleTail {
  double length = 2.3e-3;         // m
  double radius = 25e-6;          // m, of the filament
  double modulus = 0.3e9;         // Pa, Young's
  double head_radius = 0.355e-3;  // m
  void check() const;             // throws std::invalid_argument
  /// All lengths times `factor`.
  FlexibleTail scaled(double factor) const;
  /// N m^2: A = E pi r^4 / 4.
  double stiffness() const;
  double head_lever() const;  // m, from the robot's position to the head's center, along the axis
  double reach() const;       // m, from the robot's position to the tail's end
};

/// Of the straight body.
struct TailDrag {
  double tangential = 0;  // N s/m^2, of the filament per length, along it
  double normal = 0;      // N s/m^2, across it
  double head = 0;        // N s/m: Stokes' of the head
  double head_spin = 0;   // N m s
  double along = 0;       // N s/m, of the whole
  double across = 0;      // N s/m, of the whole where it does not turn
  double turning = 0;     // N m s, about the robot's position
};

/// Resistive force theory with the coefficients of a slender spheroid (Happel & Brenner 1983), and
/// Stokes' of the sphere. `viscosity` in Pa s. Throws std::invalid_argument naming a parameter.
TailDrag tail_drag(const FlexibleTail& tail, double viscosity);

/// Sperm number L (zeta_n w / A)^(1/4) (Wiggins & Goldstein 1998): length over that to which a beat
/// of `frequency` (Hz) goes along the filament before drag takes it.
double sperm_number(const FlexibleTail& tail, double viscosity, double frequency);

}  // namespace vitreo::control
