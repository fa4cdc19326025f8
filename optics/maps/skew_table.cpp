// SPDX-License-Identifier: Apache-2.0
#include "optics/maps/skew_table.h"

#include "optics/numerics/chebyshev.h"
#include "optics/numerics/linear.h"

#include <Eigen/QR>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>
#include <utility>

namespace vitreo::optics::detail {
namespace {

/// Number of radial polynomials of a harmonic. rho^k times a polynomial of degree j in rho^2 has
/// degree k + 2 j; the total degree is about the same for all harmonics.
/// So a harmonic k has terms of rho^k, rho^(k+2), ..., as a smooth function on the disc must have.
int radials_of(int harmonic, int rings) { return std::max(rings - (harmonic + 1) / 2, 1); }

/// T_0 .. T_(n-1) at x, and their derivatives, by T_k = 2 x T_(k-1) - T_(k-2).
/// The derivatives follow from differentiating the recurrence: T'_k = 2 T_(k-1) + 2 x T'_(k-1) -
/// T'_(k-2).
void chebyshev(double x, int n, double* t, double* d) {
  t[0] = 1;
  d[0] = 0;
  if (n > 1) t[1] = x, d[1] = 1;
  for (int k = 2; k < n; ++k) {
    t[k] = 2 * x * t[k - 1] - t[k - 2];
    d[k] = 2 * t[k - 1] + 2 * x * d[k - 1] - d[k - 2];
  }
}

/// The rings are Chebyshev nodes in 2 rho^2 - 1, the variable of the radial polynomials.
double ring_radius(int ring, int rings) {
  return std::sqrt((Chebyshev2::node(ring, rings) + 1) / 2);
}

/// Values at the Chebyshev nodes to coefficients: the discrete cosine transform.
/// c_q = (2 - [q = 0]) / n sum_k f(x_k) cos(q pi (k + 1/2) / n), as Chebyshev2 has it for two
/// variables.
Eigen::MatrixXd cosine_transform(int nodes) {
  Eigen::MatrixXd made(nodes, nodes);
  for (int q = 0; q < nodes; ++q) {
    for (int k = 0; k < nodes; ++k) {
      made(q, k) =
          (q == 0 ? 1.0 : 2.0) / nodes * std::cos(q * std::numbers::pi * (k + 0.5) / nodes);
    }
  }
  return made;
}

/// Coefficient of one harmonic round a ring, by the discrete Fourier transform over its arms:
/// values x depths. `ring`: the samples of the ring, ordered by arm, then depth.
Eigen::MatrixXd harmonic_of(const Eigen::MatrixXd& ring, int depths, int k, bool sine) {
  constexpr int kArms = SkewTable::kArms;
  Eigen::MatrixXd harmonic = Eigen::MatrixXd::Zero(SkewTable::kValues, depths);
  for (int arm = 0; arm < kArms; ++arm) {
    const double angle = 2 * std::numbers::pi * arm * k / kArms;
    const double weight = (k == 0 ? 1.0 : 2.0) / kArms * (sine ? std::sin(angle) : std::cos(angle));
    harmonic += weight * ring.middleRows(arm * depths, depths).transpose();
  }
  return harmonic;
}

}  // namespace

/// (xi, eta) of a sample, on the unit disc of the field; the map turns it into a point of the eye.
Eigen::Vector2d SkewTable::sample_position(int ring, int rings, int arm) {
  const double rho = ring_radius(ring, rings);
  const double azimuth = 2 * std::numbers::pi * arm / kArms;
  return {rho * std::cos(azimuth), rho * std::sin(azimuth)};
}

/// In depth and azimuth by discrete cosines and sines, along the radius by least squares for each
/// harmonic, which does not divide by small powers of rho.
/// `samples` has a row for each ring, arm and depth, the last one fastest, and a column for each
/// value: mx, my, d_ls, and the chief ray's x and y in the stop.
SkewTable::SkewTable(const Eigen::MatrixXd& samples, int rings, int depths)
    : depths_(depths), radials_(rings) {
  for (int k = 0; k <= kHarmonics; ++k) {
    for (int sine = 0; sine <= (k > 0 ? 1 : 0); ++sine) {
      for (int j = 0; j < radials_of(k, rings); ++j) terms_.push_back({k, j, sine != 0});
    }
  }
  const auto count = static_cast<Eigen::Index>(terms_.size());
  coefficients_ = Eigen::MatrixXd::Zero(kValues * count, depths);
  const Eigen::MatrixXd to_depth = cosine_transform(depths);
  double t[Chebyshev2::kMaxNodes];
  double d[Chebyshev2::kMaxNodes];
  for (std::size_t first = 0; first < terms_.size();) {
    // One harmonic, cosine or sine: its terms stand together.
    const auto [k, j0, sine] = terms_[first];
    const int radials = radials_of(k, rings);
    Eigen::MatrixXd radial(rings, radials);
    Eigen::MatrixXd seen(rings, kValues * depths);
    for (int i = 0; i < rings; ++i) {
      const double rho = ring_radius(i, rings);
      chebyshev(2 * rho * rho - 1, radials, t, d);
      for (int j = 0; j < radials; ++j) radial(i, j) = std::pow(rho, k) * t[j];
      const Eigen::MatrixXd harmonic =
          harmonic_of(samples.middleRows(i * kArms * depths, kArms * depths), depths, k, sine);
      const Eigen::MatrixXd in_depth = harmonic * to_depth.transpose();
      for (int value = 0; value < kValues; ++value)
        seen.row(i).segment(value * depths, depths) = in_depth.row(value);
    }
    const Eigen::MatrixXd fitted = least_squares(radial, seen);
    for (int value = 0; value < kValues; ++value) {
      coefficients_.middleRows(value * count + static_cast<Eigen::Index>(first), radials) =
          fitted.middleCols(value * depths, depths);
    }
    first += static_cast<std::size_t>(radials);
  }
  trim();
}

/// Drops the terms that are below rounding: most of the higher harmonics of a slight tilt.
void SkewTable::trim() {
  constexpr double kNothing = 1e-14;  // m
  const auto count = static_cast<Eigen::Index>(terms_.size());
  std::vector<Eigen::Index> kept;
  for (Eigen::Index i = 0; i < count; ++i) {
    double largest = 0;
    // Of all five values, over all depths: a term is kept for the sake of any of them.
    for (int value = 0; value < kValues; ++value) {
      largest = std::max(largest, coefficients_.row(value * count + i).cwiseAbs().maxCoeff());
    }
    if (largest > kNothing) kept.push_back(i);
  }
  const auto left = static_cast<Eigen::Index>(kept.size());
  Eigen::MatrixXd coefficients(kValues * left, depths_);
  std::vector<Term> terms;
  for (Eigen::Index i = 0; i < left; ++i) {
    const Eigen::Index from = kept[static_cast<std::size_t>(i)];
    terms.push_back(terms_[static_cast<std::size_t>(from)]);
    for (int value = 0; value < kValues; ++value) {
      coefficients.row(value * left + i) = coefficients_.row(value * count + from);
    }
  }
  terms_ = std::move(terms);
  coefficients_ = std::move(coefficients);
}

/// Values and derivatives by xi and eta of all terms, by complex powers: Re and Im of z^k are the
/// harmonics times rho^k.
/// The table is a polynomial in xi and eta, so the derivatives are exact and regular on the axis,
/// which Newton's method passes.
void SkewTable::basis(const Eigen::Vector2d& at,
                      Eigen::Matrix<double, Eigen::Dynamic, 3>& out) const {
  double t[Chebyshev2::kMaxNodes];
  double d[Chebyshev2::kMaxNodes];
  chebyshev(2 * at.squaredNorm() - 1, radials_, t, d);
  const std::complex<double> z(at.x(), at.y());
  std::array<std::complex<double>, kHarmonics + 2> power{};  // z^(k-1), the first unused
  power[1] = 1;
  for (int k = 1; k <= kHarmonics; ++k) power[k + 1] = power[k] * z;
  out.resize(static_cast<Eigen::Index>(terms_.size()), 3);
  for (std::size_t i = 0; i < terms_.size(); ++i) {
    const Term& term = terms_[i];
    // d z^k = k z^(k-1) (d xi + i d eta)
    const std::complex<double> value = power[term.harmonic + 1];
    const std::complex<double> by_xi = double(term.harmonic) * power[term.harmonic];
    const std::complex<double> by_eta = by_xi * std::complex<double>(0, 1);
    const auto part = [&](const std::complex<double>& x) {
      return term.sine ? x.imag() : x.real();
    };
    // d T_j(2 rho^2 - 1) / d xi = 4 xi T_j'.
    const double radial = t[term.radial];
    const double per = 4 * d[term.radial] * part(value);
    const auto row = static_cast<Eigen::Index>(i);
    out(row, 0) = part(value) * radial;
    out(row, 1) = part(by_xi) * radial + per * at.x();
    out(row, 2) = part(by_eta) * radial + per * at.y();
  }
}

/// The sum over the depth orders first: it is shared by the value and both derivatives in the
/// field.
SkewTable::Image SkewTable::operator()(const Eigen::Vector3d& position) const {
  Eigen::Matrix<double, Eigen::Dynamic, 3> field;
  basis(position.head<2>(), field);
  Eigen::Matrix<double, Eigen::Dynamic, 2> depth(depths_, 2);
  double t[Chebyshev2::kMaxNodes];
  double d[Chebyshev2::kMaxNodes];
  chebyshev(position.z(), depths_, t, d);
  for (int k = 0; k < depths_; ++k) depth(k, 0) = t[k], depth(k, 1) = d[k];
  const auto count = static_cast<Eigen::Index>(terms_.size());
  const Eigen::Matrix<double, Eigen::Dynamic, 2> at_depth =
      coefficients_.topRows(3 * count) * depth;
  Image image;
  for (int value = 0; value < 3; ++value) {
    const auto these = at_depth.middleRows(value * count, count);
    const Eigen::Vector3d by_field = field.transpose() * these.col(0);
    image.value[value] = by_field[0];
    image.per_position(value, 0) = by_field[1];
    image.per_position(value, 1) = by_field[2];
    image.per_position(value, 2) = field.col(0).dot(these.col(1));
  }
  return image;
}

/// Values 3 and 4: the chief ray in the plane of the stop.
/// Without derivatives: the stop decides about the shadow alone, once a position is found.
Eigen::Vector2d SkewTable::stop(const Eigen::Vector3d& position) const {
  Eigen::Matrix<double, Eigen::Dynamic, 3> field;
  basis(position.head<2>(), field);
  double t[Chebyshev2::kMaxNodes];
  double d[Chebyshev2::kMaxNodes];
  chebyshev(position.z(), depths_, t, d);
  const Eigen::Map<const Eigen::VectorXd> depth(t, depths_);
  const auto count = static_cast<Eigen::Index>(terms_.size());
  return {field.col(0).dot(coefficients_.middleRows(3 * count, count) * depth),
          field.col(0).dot(coefficients_.middleRows(4 * count, count) * depth)};
}

}  // namespace vitreo::optics::detail
