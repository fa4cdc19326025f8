// Chebyshev interpolation of a function of two variables on a rectangle: value and gradient.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <cmath>
#include <numbers>

namespace vitreo::optics::detail {

struct ValueAndGradient {
  double value;
  double du;
  double dv;
};

/// f(u, v) = sum c_ij T_i(u) T_j(v), interpolated at the roots of T_n; for a smooth function the
/// error falls as the last coefficients do (Trefethen, Approximation Theory and Approximation
/// Practice, 2013).
class Chebyshev2 {
 public:
  static constexpr int kMaxNodes = 32;
  /// Node i of n, in (-1, 1).
  static double node(int i, int n) { return std::cos(std::numbers::pi * (i + 0.5) / n); }

  Chebyshev2() = default;
  /// `values`: the function at node(row), node(column); it is interpolated there. At most kMaxNodes
  /// each way.
  explicit Chebyshev2(const Eigen::MatrixXd& values)
      : coefficients_(transform(values.rows()) * values * transform(values.cols()).transpose()) {}

  /// u and v in [-1, 1].
  ValueAndGradient operator()(double u, double v) const {
    const auto rows = coefficients_.rows();
    const auto columns = coefficients_.cols();
    double tu[kMaxNodes];
    double du[kMaxNodes];
    double tv[kMaxNodes];
    double dv[kMaxNodes];
    polynomials(u, rows, tu, du);
    polynomials(v, columns, tv, dv);
    ValueAndGradient sum{0, 0, 0};
    for (Eigen::Index j = 0; j < columns; ++j) {
      double value = 0;
      double slope = 0;
      for (Eigen::Index i = 0; i < rows; ++i) {
        value += coefficients_(i, j) * tu[i];
        slope += coefficients_(i, j) * du[i];
      }
      sum.value += value * tv[j];
      sum.du += slope * tv[j];
      sum.dv += value * dv[j];
    }
    return sum;
  }

  /// The largest coefficient of highest order: about the error that is left.
  double tail() const {
    return std::max(coefficients_.bottomRows<1>().cwiseAbs().maxCoeff(),
                    coefficients_.rightCols<1>().cwiseAbs().maxCoeff());
  }

 private:
  // Discrete cosine transform from values at the nodes to coefficients: c_k = (2 - [k = 0]) / n *
  // sum_i f(x_i) cos(k pi (i + 1/2) / n).
  static Eigen::MatrixXd transform(Eigen::Index n) {
    Eigen::MatrixXd made(n, n);
    for (Eigen::Index k = 0; k < n; ++k) {
      for (Eigen::Index i = 0; i < n; ++i) {
        made(k, i) = (k == 0 ? 1.0 : 2.0) / static_cast<double>(n) *
                     std::cos(static_cast<double>(k) * std::numbers::pi *
                              (static_cast<double>(i) + 0.5) / static_cast<double>(n));
      }
    }
    return made;
  }
  // T_k and their derivatives by the recurrence T_k = 2 x T_(k-1) - T_(k-2).
  static void polynomials(double x, Eigen::Index n, double* t, double* d) {
    t[0] = 1;
    d[0] = 0;
    if (n > 1) t[1] = x, d[1] = 1;
    for (Eigen::Index k = 2; k < n; ++k) {
      t[k] = 2 * x * t[k - 1] - t[k - 2];
      d[k] = 2 * t[k - 1] + 2 * x * d[k - 1] - d[k - 2];
    }
  }
  Eigen::MatrixXd coefficients_;
};

}  // namespace vitreo::optics::detail
