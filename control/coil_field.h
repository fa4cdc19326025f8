// Dipole field model: the field and gradient of a set of electromagnets, linear in their currents.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <random>
#include <vector>

namespace vitreo::control {

constexpr int kMaxCoils = 8;
/// Rows Bx, By, Bz (T/A), dBx/dx, dBx/dy, dBx/dz, dBy/dy, dBy/dz (T/m/A); one column a coil. The
/// other gradients follow from curl B = 0 and div B = 0. Fixed storage: no heap in the loop.
using FieldMatrix = Eigen::Matrix<double, 8, Eigen::Dynamic, Eigen::ColMajor, 8, kMaxCoils>;
using Currents = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kMaxCoils, 1>;  // A
using FieldGradient = Eigen::Matrix<double, 8, 1>;  // as FieldMatrix' rows

/// A point dipole that stands for one coil with its core; world frame.
struct Dipole {
  Eigen::Vector3d position;           // m
  Eigen::Vector3d moment_per_ampere;  // A m^2 / A
};

/// Difference of a real machine from its model: standard deviations, which reproduce the difference
/// of two calibrations of one OctoMag (facts/magnetics 1.2).
struct FieldPerturbation {
  double gain = 0.03;                 // relative, per coil
  double position = 1.2e-3;           // m, per axis
  double axis = 1.5 * 0.01745329252;  // rad
};

class CoilField {
 public:
  /// Throws std::invalid_argument for more than kMaxCoils, none, or numbers that are not finite.
  explicit CoilField(std::vector<Dipole> dipoles);
  /// The eight-coil OctoMag as one dipole a coil (facts/magnetics 1.2).
  static CoilField octomag();
  /// A machine sampled about this model: per coil a gain, a shift, and a turn of the moment about a
  /// random axis across it. Throws std::invalid_argument for a negative sigma.
  CoilField perturbed(const FieldPerturbation& sigma, std::mt19937_64& random) const;
  int coils() const { return static_cast<int>(dipoles_.size()); }
  /// Throws std::invalid_argument where the position is not finite or is a dipole's own.
  FieldMatrix matrix(const Eigen::Vector3d& position_in_world) const;
  const std::vector<Dipole>& dipoles() const { return dipoles_; }

 private:
  std::vector<Dipole> dipoles_;
};

/// The full gradient, G(i, j) = dB_i/dx_j, from the five independent entries.
Eigen::Matrix3d gradient_matrix(const FieldGradient& field);
/// F = (m . grad) B as a 3x8 matrix on FieldGradient (its first three columns are zero).
Eigen::Matrix<double, 3, 8> force_from_field(const Eigen::Vector3d& moment);

}  // namespace vitreo::control
