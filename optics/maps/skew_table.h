// Wide-angle images without rotational symmetry: a smooth function of the field (a disc) and the
// depth, as a table.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <vector>

namespace vitreo::optics::detail {

/// Real harmonics of the azimuth up to order K, Re and Im of (xi + i eta)^k, times Chebyshev
/// polynomials of 2 rho^2 - 1, times those of v: polynomials in xi, eta and v, smooth on the axis
/// (as Zernike's are). rho^2 = xi^2 + eta^2 <= 1, v in [-1, 1].
class SkewTable {
 public:
  static constexpr int kHarmonics = 7;              // K
  static constexpr int kArms = 2 * kHarmonics + 2;  // azimuths sampled on each ring
  static constexpr int kValues = 5;  // mx, my, focus; the chief ray's position in the stop
  using Values = Eigen::Matrix<double, kValues, 1>;
  struct Image {
    Eigen::Vector3d value;         // mx, my, focus; m
    Eigen::Matrix3d per_position;  // by xi, eta, v
  };

  SkewTable() = default;
  /// Ring i of `rings` and arm j: where its samples are on the unit disc; depth sample k is at
  /// Chebyshev2::node.
  static Eigen::Vector2d sample_position(int ring, int rings, int arm);
  /// `samples`, a row each, ordered by ring, arm, depth, the depth fastest. Least squares.
  SkewTable(const Eigen::MatrixXd& samples, int rings, int depths);

  Image operator()(const Eigen::Vector3d& position) const;
  Eigen::Vector2d stop(const Eigen::Vector3d& position) const;

 private:
  struct Term {
    int harmonic;
    int radial;
    bool sine;
  };
  void trim();
  void basis(const Eigen::Vector2d& at, Eigen::Matrix<double, Eigen::Dynamic, 3>& out) const;
  int depths_ = 0;
  int radials_ = 0;
  std::vector<Term> terms_;
  Eigen::MatrixXd coefficients_;  // a block of terms for each value; depth orders across
};

}  // namespace vitreo::optics::detail
