// SPDX-License-Identifier: Apache-2.0
#include "control/curve_fit.h"

#include "control/preconditions.h"

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <ceres/ceres.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <utility>

namespace vitreo::control {
namespace {

// Rows of the least squares are divided by sigma: the roots of the weights 1 / sigma^2.
Eigen::VectorXd weights_of(const CurveSamples& samples) {
  const auto count = static_cast<Eigen::Index>(samples.x.size());
  Eigen::VectorXd weights = Eigen::VectorXd::Ones(count);
  for (Eigen::Index i = 0; i < count && !samples.sigma.empty(); ++i)
    weights[i] = 1 / samples.sigma[static_cast<std::size_t>(i)];
  return weights;
}

/// What follows from parameters and the weighted Jacobian J = d(curve / sigma)/dp: chi square,
/// cov = (J' J)^-1, times chi square per degree of freedom where the sigmas are not known.
void conclude(CurveFit& fit, const CurveSamples& samples, const Eigen::MatrixXd& jacobian) {
  const Eigen::VectorXd weights = weights_of(samples);
  double squares = 0;
  for (std::size_t i = 0; i < samples.x.size(); ++i) {
    const double residual = samples.y[i] - fit.fitted[i];
    squares += residual * residual;
    fit.chi_square += std::pow(residual * weights[static_cast<Eigen::Index>(i)], 2);
  }
  fit.rms = std::sqrt(squares / static_cast<double>(samples.x.size()));
  fit.degrees_of_freedom =
      static_cast<int>(samples.x.size()) - static_cast<int>(fit.parameters.size());
  // By R of J P = Q R, which keeps the digits that J' J would lose; columns are brought to length
  // one first.
  const Eigen::VectorXd lengths = jacobian.colwise().norm();
  if (!(lengths.minCoeff() > 0)) throw std::runtime_error("the samples do not fix every parameter");
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(
      Eigen::MatrixXd(jacobian * lengths.cwiseInverse().asDiagonal()));
  if (qr.rank() < jacobian.cols())
    throw std::runtime_error("the samples do not fix every parameter");
  const Eigen::Index n = jacobian.cols();
  const Eigen::MatrixXd r = qr.matrixR().topLeftCorner(n, n).triangularView<Eigen::Upper>();
  const Eigen::MatrixXd inverse =
      qr.colsPermutation() *
      Eigen::MatrixXd(r.triangularView<Eigen::Upper>().solve(Eigen::MatrixXd::Identity(n, n)));
  // (J' J)^-1 = (P R^-1) (P R^-1)', then the lengths of the columns are divided out.
  fit.covariance = inverse * inverse.transpose();
  fit.covariance.array() /= (lengths * lengths.transpose()).array();
  // The variance of y is estimated by s^2 = chi square / (n - p); check() saw to n > p.
  if (samples.sigma.empty()) fit.covariance *= fit.chi_square / fit.degrees_of_freedom;
}

/// Residuals of the curve in scaled parameters, by the sigmas or by the spread of y: the solver's
/// tolerances are for numbers about 1. What the curve throws must not pass through Ceres: it is
/// kept, and the fit ends at once, for nothing is left to be minimized.
struct Residuals {
  const Curve& curve;
  const CurveSamples& samples;
  const Eigen::VectorXd& scales;
  double size;  // of y
  std::exception_ptr& thrown;

  bool operator()(double const* const* blocks, double* residuals) const {
    try {
      const Eigen::VectorXd parameters =
          Eigen::Map<const Eigen::VectorXd>(blocks[0], scales.size()).cwiseProduct(scales);
      for (std::size_t i = 0; i < samples.x.size(); ++i) {
        const double sigma = samples.sigma.empty() ? size : samples.sigma[i];
        residuals[i] = (curve(parameters, samples.x[i]) - samples.y[i]) / sigma;
        // Ceres takes false for a step that went too far, and tries a shorter one.
        if (!std::isfinite(residuals[i])) return false;
      }
    } catch (...) {
      thrown = std::current_exception();
      std::fill_n(residuals, samples.x.size(), 0.0);
    }
    return true;
  }
};

/// Rows of the cost's Jacobian at `scaled`, by Ridders' differences.
Eigen::MatrixXd jacobian_at(const ceres::CostFunction& cost, const Eigen::VectorXd& scaled,
                            std::size_t rows) {
  // Row by row, as Ceres writes a Jacobian.
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> jacobian(
      static_cast<Eigen::Index>(rows), scaled.size());
  Eigen::VectorXd residuals(static_cast<Eigen::Index>(rows));
  const double* blocks[] = {scaled.data()};
  double* jacobians[] = {jacobian.data()};
  if (!cost.Evaluate(blocks, residuals.data(), jacobians))
    throw std::runtime_error("the curve has no finite value near the fit");
  return jacobian;
}

std::pair<double, double> ends(const std::vector<double>& values) {
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  return {*low, *high};
}

/// Indices in the order of x.
std::vector<std::size_t> order_of(const std::vector<double>& x) {
  std::vector<std::size_t> order(x.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](auto a, auto b) { return x[a] < x[b]; });
  return order;
}

/// A sum y = a e^(cx) + b obeys y - y1 = -bc (x - x1) + c * (the integral of y from x1): the rate
/// is the slope of a linear fit (Jacquelin, Regressions et equations integrales, 2009).
double rate_by_integral(const CurveSamples& samples) {
  const std::vector<std::size_t> order = order_of(samples.x);
  Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
  Eigen::Vector2d right = Eigen::Vector2d::Zero();
  double integral = 0;
  for (std::size_t k = 1; k < order.size(); ++k) {
    const std::size_t now = order[k], before = order[k - 1], first = order[0];
    // The trapezoidal rule, over the samples in the order of x.
    integral += (samples.x[now] - samples.x[before]) * (samples.y[now] + samples.y[before]) / 2;
    const Eigen::Vector2d row(samples.x[now] - samples.x[first], integral);
    normal += row * row.transpose();
    right += row * (samples.y[now] - samples.y[first]);
  }
  return normal.ldlt().solve(right)[1];
}

}  // namespace

void CurveSamples::check(int parameters) const {
  require(x.size() == y.size(), "x and y: wants as many numbers in each");
  require(sigma.empty() || sigma.size() == x.size(), "sigma: wants a number for each x");
  for (std::size_t i = 0; i < x.size(); ++i) {
    require(std::isfinite(x[i]) && std::isfinite(y[i]), "x and y: wants finite numbers");
    require(sigma.empty() || positive(sigma[i]), "sigma: wants positive numbers");
  }
  if (static_cast<int>(x.size()) <= parameters)
    throw std::invalid_argument("x: wants more than " + std::to_string(parameters) +
                                " samples, for the curve has so many parameters");
}

double CurveFit::sigma(int parameter) const { return std::sqrt(covariance(parameter, parameter)); }

// In t = (x - middle) / half, |t| <= 1; the coefficients of x follow by the binomial theorem, as a
// matrix, which carries the covariance too.
CurveFit fit_polynomial(const CurveSamples& samples, int degree) {
  require(degree >= 0 && degree <= 12, "degree: wants 0 to 12");
  samples.check(degree + 1);
  const auto [low, high] = ends(samples.x);
  const double middle = (low + high) / 2, half = std::max((high - low) / 2, 1e-300);
  require(degree == 0 || high > low, "x: wants different values");
  const auto count = static_cast<Eigen::Index>(samples.x.size());
  const Eigen::VectorXd weights = weights_of(samples);
  Eigen::MatrixXd powers(count, degree + 1);
  for (Eigen::Index i = 0; i < count; ++i)
    for (int k = 0; k <= degree; ++k)
      powers(i, k) = std::pow((samples.x[static_cast<std::size_t>(i)] - middle) / half, k);
  const Eigen::MatrixXd weighted = weights.asDiagonal() * powers;
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(weighted);
  require(qr.rank() == degree + 1, "x: wants more different values than the degree");
  const Eigen::Map<const Eigen::VectorXd> y(samples.y.data(), count);
  CurveFit fit;
  fit.parameters = qr.solve(Eigen::VectorXd(weights.cwiseProduct(y)));
  const Eigen::VectorXd fitted = powers * fit.parameters;
  fit.fitted.assign(fitted.begin(), fitted.end());
  conclude(fit, samples, weighted);
  // t^k = half^-k sum_j binomial(k, j) (-middle)^(k - j) x^j
  Eigen::MatrixXd back = Eigen::MatrixXd::Zero(degree + 1, degree + 1);
  for (int k = 0; k <= degree; ++k) {
    double binomial = 1;
    for (int j = 0; j <= k; ++j) {
      back(j, k) = binomial * std::pow(-middle, k - j) / std::pow(half, k);
      binomial = binomial * (k - j) / (j + 1);
    }
  }
  fit.parameters = back * fit.parameters;
  fit.covariance = back * fit.covariance * back.transpose();
  return fit;
}

CurveFit fit_exponential(const CurveSamples& samples) {
  samples.check(3);
  const auto [low, high] = ends(samples.x);
  require(high > low, "x: wants different values");
  double rate = rate_by_integral(samples);
  // Noise may give any rate. One beyond 100 / span makes the curve a step, in which the rate does
  // not show: the fit would have no slope to follow.
  if (!std::isfinite(rate) || rate == 0 || std::fabs(rate) * (high - low) > 100)
    rate = -1 / (high - low);
  // With the rate given amplitude and offset are a line in e^(rate x).
  const double start = low;
  CurveSamples line = samples;
  for (double& x : line.x) x = std::exp(rate * (x - start));
  const CurveFit guess = fit_polynomial(line, 1);
  const auto [least, most] = ends(samples.y);
  const double size = std::max(most - least, std::numeric_limits<double>::min());
  // Fitted at the first x, where e^0 is 1, and brought to x = 0 afterwards.
  CurveSamples shifted = samples;
  for (double& x : shifted.x) x -= start;
  CurveFit fit =
      fit_curve([](const Eigen::VectorXd& p, double x) { return p[0] * std::exp(p[1] * x) + p[2]; },
                shifted, Eigen::Vector3d(guess.parameters[1], rate, guess.parameters[0]),
                Eigen::Vector3d(size, 1 / (high - low), size));
  // a0 = a1 e^(-c x1), so da0/da1 = e^(-c x1) and da0/dc = -x1 a0: with these as B the covariance
  // is B C B' (propagation of errors to first order).
  const double factor = std::exp(-fit.parameters[1] * start);
  Eigen::Matrix3d back = Eigen::Matrix3d::Identity();
  back(0, 0) = factor;
  back(0, 1) = -start * fit.parameters[0] * factor;
  fit.parameters[0] *= factor;
  fit.covariance = back * fit.covariance * back.transpose();
  return fit;
}

// The start: the offset is the end of y's range that is nearer to the median, as most samples lie
// beside the peak; the peak is where y is farthest from it, the width follows from the area,
// amplitude * width * sqrt(2 pi).
CurveFit fit_gaussian(const CurveSamples& samples) {
  samples.check(4);
  const std::vector<std::size_t> order = order_of(samples.x);
  const auto [low, high] = ends(samples.x);
  require(high > low, "x: wants different values");
  std::vector<double> sorted = samples.y;
  std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2),
                   sorted.end());
  const auto [least, most] = ends(samples.y);
  const double median = sorted[sorted.size() / 2];
  const bool peak = most - median >= median - least;
  const double offset = peak ? least : most, amplitude = peak ? most - least : least - most;
  double area = 0, center = samples.x[order[0]], farthest = -1;
  for (std::size_t k = 0; k < order.size(); ++k) {
    const double above = samples.y[order[k]] - offset;
    if (std::fabs(above) > farthest) farthest = std::fabs(above), center = samples.x[order[k]];
    if (k > 0)
      area += (samples.x[order[k]] - samples.x[order[k - 1]]) *
              (above + samples.y[order[k - 1]] - offset) / 2;
  }
  constexpr double kRootTwoPi = 2.5066282746310002;
  const double size = std::max(std::fabs(amplitude), std::numeric_limits<double>::min());
  const double width =
      std::clamp(std::fabs(area) / (size * kRootTwoPi), (high - low) / 1000, high - low);
  CurveFit fit = fit_curve(
      [](const Eigen::VectorXd& p, double x) {
        const double t = (x - p[1]) / p[2];
        return p[0] * std::exp(-t * t / 2) + p[3];
      },
      samples, Eigen::Vector4d(amplitude, center, width, offset),
      Eigen::Vector4d(size, width, width, size));
  // The curve holds the square of the width: the sign that the solver found is chance.
  fit.parameters[2] = std::fabs(fit.parameters[2]);
  return fit;
}

// Levenberg-Marquardt, which Ceres takes unless it is told otherwise; QR of J for its steps, since
// the normal equations would square the condition number. J is by Ridders' extrapolated differences
// (Adv. Eng. Software 4, 1982, 75): a curve that a script gives has no derivative of its own, and
// forward differences would cost the covariance digits.
CurveFit fit_curve(const Curve& curve, const CurveSamples& samples, const Eigen::VectorXd& start,
                   Eigen::VectorXd scales) {
  samples.check(static_cast<int>(start.size()));
  require(start.size() > 0 && start.allFinite(), "start: wants finite numbers");
  if (scales.size() == 0)
    scales = start.unaryExpr([](double value) { return value == 0 ? 1 : std::fabs(value); });
  require(scales.size() == start.size() && scales.minCoeff() > 0,
          "scales: wants a positive number for each parameter");
  for (const double x : samples.x)
    require(std::isfinite(curve(start, x)), "start: the curve has no finite value there");
  const auto [least, most] = ends(samples.y);
  const double size = most > least ? most - least : std::max(std::fabs(most), 1e-300);
  std::exception_ptr thrown;
  auto* cost = new ceres::DynamicNumericDiffCostFunction<Residuals, ceres::RIDDERS>(
      new Residuals{curve, samples, scales, size, thrown});  // the problem owns it
  cost->AddParameterBlock(static_cast<int>(start.size()));
  cost->SetNumResiduals(static_cast<int>(samples.x.size()));
  ceres::Problem problem;
  Eigen::VectorXd scaled = start.cwiseQuotient(scales);
  problem.AddResidualBlock(cost, nullptr, scaled.data());
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.max_num_iterations = 500;
  options.function_tolerance = 1e-16;
  options.parameter_tolerance = 1e-13;
  options.gradient_tolerance = 1e-15;
  options.logging_type = ceres::SILENT;
  // The curve may be a function of Lua, whose state only one thread may enter.
  options.num_threads = 1;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  if (thrown) std::rethrow_exception(thrown);
  if (summary.termination_type == ceres::FAILURE || !scaled.allFinite())
    throw std::runtime_error("the fit does not converge; other start values may help");
  CurveFit fit;
  fit.parameters = scaled.cwiseProduct(scales);
  for (const double x : samples.x) fit.fitted.push_back(curve(fit.parameters, x));
  // The residuals were divided by the size of y there: conclude() wants those of the curve itself.
  const double weight = samples.sigma.empty() ? size : 1;  // sigma is 1 where it is not known
  conclude(fit, samples, weight * jacobian_at(*cost, scaled, samples.x.size()));
  // From scaled parameters q = p / s back to p: cov(p_i, p_j) = s_i s_j cov(q_i, q_j).
  fit.covariance.array() *= (scales * scales.transpose()).array();
  return fit;
}

}  // namespace vitreo::control
