// Rotating and oscillating field: the currents of a field that turns about an axis, or swings to
// both sides of it, with the coils' lag made good.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/box_allocation.h"

#include <optional>

namespace vitreo::control {

/// How the field moves the robot: helix, turned about its own axis, swims along it; roller and
/// tumbler, turned about an axis along a wall, go over it (a tumbler end over end). oscillating:
/// the field swings in a plane and beats a flexible tail, whose head goes first along the axis.
enum class RotatingMode { helix, roller, tumbler, oscillating };
const char* to_string(RotatingMode mode);

/// A field B (e1 cos phi + e2 sin phi), e1, e2 and the axis right-handed.
struct Rotation {
  Eigen::Vector3d axis{0, 0, 1};   // unit, world
  Eigen::Vector3d first{1, 0, 0};  // e1: unit, across the axis
  double frequency = 0;            // Hz; negative: the other way round
  double field = 0;                // T, its largest magnitude
  /// rad. With it the field oscillates (Dreyfus et al. 2005, Nature 437, 862): a part B cos(swing)
  /// stands along the axis, and B sin(swing) sin(phi) goes along e1.
  std::optional<double> swing{};
  /// The same about another axis (unit), the phase kept: e1 turned by the smallest rotation between
  /// the axes.
  void turn_to(const Eigen::Vector3d& other);
};

/// T, to be commanded at the time of phase `phase` (rad), for a field of that phase behind a
/// first-order lag of `lag` s: b + lag b', exact while axis and frequency stay. `hold`: s for which
/// each set-point is held; its fundamental is weaker by sinc(f hold).
Eigen::Vector3d commanded_field(const Rotation& rotation, double phase, double lag, double hold);
/// The largest magnitude of it over the field's.
double emphasis(double frequency, double lag, double hold);

/// Currents per field, A/T, for a field without gradient: least squares of [B; g L], L = 20 mm,
/// which eight coils solve exactly; the coils whose limit is 0 are left out, and then the field
/// counts before the gradient.
using FieldCurrents = Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::ColMajor, kMaxCoils, 3>;
FieldCurrents uniform_field_currents(const FieldMatrix& matrix, const CurrentLimits& limits);

struct RotationLimits {
  CurrentLimits currents = CurrentLimits::Constant(8, 12);  // A; 0 for a dead coil
  double total = 60;                                        // A, sum of magnitudes
  double slew = 2000;                                       // A/s of a coil
  double lag = 0.0106;                                      // s, of the coils
  double update = 2e-3;                                     // s between set-points
};

/// Set-points a turn, at least: with fewer, the steps' images turn the field unevenly by more than
/// a tenth behind coils of 15 Hz.
constexpr double kSetPointsPerTurn = 6;

/// Part of `field` (T) that the limits let turn at `frequency` (Hz) about `axis`; 1: all.
double reachable_part(const FieldCurrents& currents, const Rotation& rotation,
                      const RotationLimits& limits);
/// Hz: the fastest at which the whole field of `rotation` is within the limits, 0 where it is not
/// even at rest.
double fastest(const FieldCurrents& currents, const Rotation& rotation,
               const RotationLimits& limits);

}  // namespace vitreo::control
