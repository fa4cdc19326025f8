// SPDX-License-Identifier: Apache-2.0
#include "optics/pose/ellipse_weight.h"

#include "optics/numerics/preconditions.h"

#include <Eigen/Dense>

#include <cmath>
#include <stdexcept>

namespace vitreo::optics::detail {
namespace {

using Matrix5 = Eigen::Matrix<double, 5, 5>;

/// d smooth / d (center, axes, angle), the elongation along and across the observed direction.
/// Rows: center, mean semi-axis, and d = (a - b) / 2 along and across: d(d cos 2 phi) = dd and d(d
/// sin 2 phi) = 2 d dphi at phi = 0.
Matrix5 derivative(double half_difference) {
  Matrix5 by = Matrix5::Zero();
  by(0, 0) = by(1, 1) = 1;
  by(2, 2) = by(2, 3) = 0.5;
  by(3, 2) = 0.5, by(3, 3) = -0.5;
  by(4, 4) = 2 * half_difference;
  return by;
}

/// Smooth coordinates turned so that the elongation is along the observed direction.
/// A vector of twice the angle turns by twice the angle.
Matrix5 turned(double angle) {
  Matrix5 turn = Matrix5::Identity();
  const double cosine = std::cos(2 * angle);
  const double sine = std::sin(2 * angle);
  turn(3, 3) = cosine, turn(3, 4) = sine;
  turn(4, 3) = -sine, turn(4, 4) = cosine;
  return turn;
}

/// W with W^T W = C^-1, from the Cholesky factor C = L L^T: W = L^-1 (whitening).
template <int kSize>
/// Throws std::invalid_argument naming the covariance where it is not positive definite: its
/// inverse would weigh by infinity.
Eigen::Matrix<double, kSize, kSize> inverse_root(
    const Eigen::Matrix<double, kSize, kSize>& covariance) {
  const Eigen::LLT<Eigen::Matrix<double, kSize, kSize>> factor(covariance);
  if (factor.info() != Eigen::Success || !(factor.matrixLLT().diagonal().minCoeff() > 0)) {
    throw std::invalid_argument("covariance: must be positive definite");
  }
  return factor.matrixL().solve(Eigen::Matrix<double, kSize, kSize>::Identity());
}

}  // namespace

/// With d = (a - b) / 2, smooth(3, 3) is the variance of d along the observed direction.
/// An angle that is not known takes the elongation of a long ellipse out (three terms are left); of
/// a round one both components count alike. A huge variance of the angle would not do, since the
/// propagation is of first order.
EllipseWeight ellipse_weight(const Eigen::Matrix<double, 5, 1>& observed,
                             const Matrix5& covariance) {
  constexpr double kSigmas = 3;  // of the difference of the axes, below which there is no direction
  constexpr double kKnown = 0.25;  // rad
  detail::require(covariance.allFinite(), "covariance: must be finite");
  if ((covariance - covariance.transpose()).cwiseAbs().maxCoeff() >
      1e-9 * covariance.cwiseAbs().maxCoeff()) {
    throw std::invalid_argument("covariance: must be symmetric");
  }
  inverse_root<4>(covariance.topLeftCorner<4, 4>());  // of the lengths by themselves, or refused
  const double half = (observed[2] - observed[3]) / 2;
  const Matrix5 by = derivative(half);
  // First-order propagation: J C J^T.
  Matrix5 smooth = by * covariance * by.transpose();
  EllipseWeight weight{Matrix5::Zero(), 5};
  const bool round = half * half < kSigmas * kSigmas * smooth(3, 3);
  if (!round && covariance(4, 4) > kKnown * kKnown) {
    // d itself, not its projection on a direction that is not known: |elongation| is not linear, so
    // it is left out too.
    weight.root.topLeftCorner<3, 3>() = inverse_root<3>(smooth.topLeftCorner<3, 3>());
    weight.terms = 3;
    return weight;
  }
  if (round) {
    // No direction in which the ellipse is long: the elongation's two components count alike.
    smooth.row(4).setZero();
    smooth.col(4).setZero();
    smooth(4, 4) = smooth(3, 3);
  }
  weight.root = inverse_root<5>(smooth) * turned(observed[4]);
  return weight;
}

}  // namespace vitreo::optics::detail
