// Least-squares fits of curves to samples, with the parameters' covariance and chi square: lines,
// polynomials, exponentials, Gaussians, and curves of one's own.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <functional>
#include <vector>

namespace vitreo::control {

/// Samples of a curve. Without `sigma` all are taken for equally uncertain, and how much is
/// estimated from what is left over; with it each has its own standard deviation.
struct CurveSamples {
  std::vector<double> x;
  std::vector<double> y;
  std::vector<double> sigma{};  // of y; empty: not known

  /// Throws std::invalid_argument naming the list: unequal lengths, a number that is not finite, a
  /// sigma that is not positive, not more samples than `parameters`.
  void check(int parameters) const;
};

struct CurveFit {
  Eigen::VectorXd parameters;
  Eigen::MatrixXd covariance;
  double chi_square = 0;  // sum of ((y - curve) / sigma)^2; with sigma 1 where it is not known
  int degrees_of_freedom = 0;
  double rms = 0;                // of y - curve
  std::vector<double> fitted{};  // the curve at each x

  double sigma(int parameter) const;
};

/// y = c0 + c1 x + ... + cn x^n: linear least squares by QR, in a variable that is centered and
/// scaled, so that micrometers raised to the fifth power do no harm. Degree 1 is the line.
/// Throws std::invalid_argument as check() does, and for x of fewer distinct values than
/// coefficients.
CurveFit fit_polynomial(const CurveSamples& samples, int degree);

/// y = amplitude * exp(rate x) + offset; {amplitude, rate, offset}.
CurveFit fit_exponential(const CurveSamples& samples);

/// y = amplitude * exp(-(x - center)^2 / (2 width^2)) + offset; {amplitude, center, width, offset}.
CurveFit fit_gaussian(const CurveSamples& samples);

using Curve = std::function<double(const Eigen::VectorXd& parameters, double x)>;
/// A curve of one's own, from `start`; `scales` are sizes of its parameters (empty: those of
/// `start`, 1 where that is 0). What the curve throws passes through. Throws std::runtime_error
/// where the fit does not converge, or where the samples do not fix a parameter.
CurveFit fit_curve(const Curve& curve, const CurveSamples& samples, const Eigen::VectorXd& start,
                   Eigen::VectorXd scales = {});

}  // namespace vitreo::control
