// SPDX-License-Identifier: Apache-2.0
#include "vision/ellipse_fit.h"

#include "vision/robust.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace vitreo::vision {
namespace {

using Vector5 = Eigen::Matrix<double, 5, 1>;
using Matrix5 = Eigen::Matrix<double, 5, 5>;

constexpr int kFitRounds = 6;
constexpr double kSmallestScale = 0.1;  // px: below it nothing is an outlier
constexpr double kModelError = 0.05;    // px: what the model of a rim may miss at one normal
constexpr double kSystematic = 0.02;    // px: what it may miss all round
// Of normal residuals r the biweight w lets a fit scatter by E[psi^2] / E[psi']^2, psi = w r (Huber
// 1981, 7.6), where the weighted residuals show E[w r^2] / E[w]^2: 1.0526 / 0.9049 at kTukey.
constexpr double kRobustLoss = 1.163271676;
constexpr double kFewest = 0.35;  // of the normals, that must agree
constexpr std::size_t kMostNormals = 1024;

// Jacobian of the rim's distance along a normal by center and shape matrix (Sxx, Sxy, Syy): a rim
// point c + S q moves by dc + dS q, of which the component along the unit normal n counts. The
// tangential part is second order, so this is the geometric (orthogonal) distance to first order.
// Its residual is the normal's measured shift less row . step.
Vector5 jacobian_row(const Normal& n) {
  Vector5 row;
  row << n.outward, n.outward.x() * n.circle.x(),
      n.outward.x() * n.circle.y() + n.outward.y() * n.circle.x(), n.outward.y() * n.circle.y();
  return row;
}

// The normals that have a cut, as a round of the fit asks for them: Jacobian, distance and inverse
// variance are computed once. On the stack: nothing is allocated per image.
class Equations {
 public:
  // At most kMostNormals.
  explicit Equations(const std::vector<Normal>& normals) : all_(normals.size()) {
    for (const Normal& n : normals) {
      if (!n.found) continue;
      Eigen::Map<Vector5>(rows_[count_].data()) = jacobian_row(n);
      rows_[count_][5] = n.shift_px;
      // kModelError keeps one very sharp normal from outweighing all others.
      certainty_[count_] = 1 / (n.variance + kModelError * kModelError);
      weight_[count_++] = 1;
    }
  }

  // Five unknowns and some normals to spare: at least 8, and the share kFewest of all.
  // Below that an ellipse can be drawn through anything.
  bool enough() const {
    const auto agree = std::count_if(weight_.begin(), weight_.begin() + count_,
                                     [](double weight) { return weight > 0; });
    return static_cast<double>(agree) >= std::max(kFewest * static_cast<double>(all_), 8.0);
  }

  // Normal equations J' W J and, in `right`, J' W d, W the inverse variances times the robust
  // weights. Errors that `correlation_length` neighbors share count once.
  Matrix5 information(double correlation_length, Vector5& right) const {
    std::array<std::array<double, 6>, 5> sum{};
    for (std::size_t k = 0; k < count_; ++k) {
      const double w = weight_[k] * certainty_[k];
      const Row& row = rows_[k];
      for (std::size_t i = 0; i < 5; ++i)
        for (std::size_t j = 0; j < 6; ++j) sum[i][j] += w * row[i] * row[j];
    }
    Matrix5 matrix;
    for (Eigen::Index i = 0; i < 5; ++i) {
      const std::array<double, 6>& of = sum[static_cast<std::size_t>(i)];
      matrix.row(i) = Eigen::Map<const Vector5>(of.data()).transpose() / correlation_length;
      right[i] = of[5] / correlation_length;
    }
    return matrix;
  }

  // Robust weights of the residuals in units of their scale s: Cauchy 1 / (1 + (r / s)^2) if
  // `gently`, else Tukey's biweight (1 - (r / (c s))^2)^2.
  // Cauchy's weights never reach 0, so a normal may come back; Tukey's end the influence of what is
  // clearly another rim.
  void reweight(const Vector5& step, bool gently) {
    std::array<double, kMostNormals> off;
    for (std::size_t k = 0; k < count_; ++k) off[k] = std::abs(residual(k, step));
    const double scale = scale_of(off);
    const double per_tukey = 1 / (kTukey * kTukey);
    for (std::size_t k = 0; k < count_; ++k) {
      const double r = residual(k, step) / scale;
      const double inside = std::max(1 - r * r * per_tukey, 0.0);
      // The first rounds reject no normal altogether: from a bad start the wrong ones would go.
      weight_[k] = gently ? 1 / (1 + r * r) : inside * inside;
    }
  }

  // Reduced chi-square of the residuals, with 5 parameters.
  double chi_square(const Vector5& step) const {
    double squares = 0;
    double count = 0;
    for (std::size_t k = 0; k < count_; ++k) {
      const double off = residual(k, step);
      squares += weight_[k] * certainty_[k] * off * off;
      count += weight_[k];
    }
    return squares / std::max(count - 5, 1.0);
  }

  void give_weights(std::vector<Normal>& normals) const {
    std::size_t k = 0;
    for (Normal& n : normals) n.weight = n.found ? weight_[k++] : 0;
  }

 private:
  using Row = std::array<double, 6>;  // of the Jacobian, and the distance

  double residual(std::size_t k, const Vector5& step) const {
    const Row& row = rows_[k];
    return row[5] - (row[0] * step[0] + row[1] * step[1] + row[2] * step[2] + row[3] * step[3] +
                     row[4] * step[4]);
  }
  // Median absolute residual, as the standard deviation of a normal distribution.
  // By the median, so that up to half of the normals may be wrong.
  double scale_of(std::array<double, kMostNormals>& off) const {
    const auto middle = off.begin() + count_ / 2;
    std::nth_element(off.begin(), middle, off.begin() + count_);
    return std::max(kMadToSigma * *middle, kSmallestScale);
  }

  std::size_t all_;
  std::size_t count_ = 0;
  std::array<Row, kMostNormals> rows_;
  std::array<double, kMostNormals> certainty_;
  std::array<double, kMostNormals> weight_;
};

// Derivatives of (u, v, a, b, angle) by (u, v, Sxx, Sxy, Syy), by first-order perturbation of the
// eigenvectors e, f of S: da = e' dS e, db = f' dS f, dangle = e' dS f / (a - b). Where the axes
// are equal within their uncertainty, the divisor is regularized such that the angle's variance
// tends to pi^2 / 12, that of a uniform distribution over pi, instead of to infinity.
// `covariance` is that of the shape's five unknowns.
Matrix5 axes_from_shape(const Ellipse& ellipse, const Matrix5& covariance) {
  const double c = std::cos(ellipse.angle);
  const double s = std::sin(ellipse.angle);
  Matrix5 j = Matrix5::Zero();
  j(0, 0) = j(1, 1) = 1;
  j.row(2).tail<3>() << c * c, 2 * c * s, s * s;
  j.row(3).tail<3>() << s * s, -2 * c * s, c * c;
  j.row(4).tail<3>() << -c * s, c * c - s * s, c * s;
  const double variance = (j.row(4) * covariance * j.row(4).transpose()).value();
  const double apart = ellipse.semi_major_px - ellipse.semi_minor_px;
  j.row(4) /=
      std::sqrt(apart * apart + 12 / (std::numbers::pi * std::numbers::pi) * variance + 1e-30);
  return j;
}

// A prior in the fit's unknowns: of the step in (u, v, Sxx, Sxy, Syy) from `start`.
struct StepPrior {
  Matrix5 information = Matrix5::Zero();
  Vector5 right = Vector5::Zero();
};

// The prior's information J' Sigma^-1 J and right-hand side, J as in axes_from_shape() at the
// prior's angle, but for the turn, which counts as the displacement of the rim (a - b) dangle.
// Null: nothing is known beforehand, and both parts are 0. Sigmas of a prior are in px, the angle's
// in rad.
StepPrior prior_of(const Ellipse& start, const EllipsePrior* prior) {
  StepPrior result;
  if (prior == nullptr) return result;
  const double c = std::cos(prior->ellipse.angle);
  const double s = std::sin(prior->ellipse.angle);
  // (u, v, a, b, turn times difference of the axes) by the step.
  Matrix5 j = Matrix5::Zero();
  j(0, 0) = j(1, 1) = 1;
  j.row(2).tail<3>() << c * c, 2 * c * s, s * s;
  j.row(3).tail<3>() << s * s, -2 * c * s, c * c;
  j.row(4).tail<3>() << -c * s, c * c - s * s, c * s;
  // At least 1 px, so that the prior of a circle's angle still regularizes.
  const double apart = std::max(prior->ellipse.semi_major_px - prior->ellipse.semi_minor_px, 1.0);
  Vector5 sigma;
  sigma << prior->center_px, prior->center_px, prior->semi_axes_px, prior->semi_axes_px,
      prior->angle * apart;
  const Matrix5 weighted = sigma.cwiseProduct(sigma).cwiseInverse().asDiagonal() * j;
  const Eigen::Matrix2d shape = prior->ellipse.shape() - start.shape();
  Vector5 wanted;
  wanted << prior->ellipse.center_px - start.center_px, shape(0, 0), shape(0, 1), shape(1, 1);
  result.information = j.transpose() * weighted;
  result.right = result.information * wanted;
  return result;
}

// (J' W J / s^2 + prior)^-1, s^2 the reduced chi-square of the residuals with 5 parameters times
// what the weights hide of their scatter, propagated to center, axes and angle. s^2 is at least
// 1/4, lest a few normals that happen to agree shrink it. kSystematic is what no scatter along the
// rim shows. A few pixels' noise is correlated along the rim, hence `correlation_length`, in
// normals. The result is that of (u, v, a, b, angle), px^2 and rad^2, made symmetric against
// rounding.
Matrix5 covariance_of(const Ellipse& ellipse, const Equations& equations, const Vector5& step,
                      const StepPrior& prior, double correlation_length) {
  const double residual = std::max(kRobustLoss * equations.chi_square(step), 0.25);
  Vector5 right;
  const Matrix5 shape =
      (equations.information(correlation_length, right) / residual + prior.information).inverse();
  const Matrix5 j = axes_from_shape(ellipse, shape);
  Matrix5 result = j * shape * j.transpose();
  // All but the angle: a common shift of the rim does not turn it.
  for (int k = 0; k < 4; ++k) result(k, k) += kSystematic * kSystematic;
  return (result + result.transpose()) / 2;
}

}  // namespace

// `normals` has the number wanted; all their measurements are reset. Equal steps of the parameter,
// denser where the rim is curved.
void place_normals(const Ellipse& ellipse, std::vector<Normal>& normals) {
  const Eigen::Matrix2d shape = ellipse.shape();
  const Eigen::Matrix2d inverse = shape.inverse();
  const double between = 2 * std::numbers::pi / static_cast<double>(normals.size());
  const Eigen::Rotation2Dd next(between);
  const Eigen::Matrix2d turn = next.toRotationMatrix();
  Eigen::Vector2d circle(std::cos(ellipse.angle), std::sin(ellipse.angle));
  for (Normal& n : normals) {
    // The circle's point at t from the major axis, whose image S q is Ellipse::point(t); the
    // gradient of |S^-1 (p - c)| there is along S^-1 q.
    n = Normal{};
    n.circle = circle;
    circle = turn * circle;  // loses an ulp a step, of at most 1024
    n.rim_px = ellipse.center_px + shape * n.circle;
    n.outward = (inverse * n.circle).normalized();
  }
}

// The distances are linear in the step, so every round solves one weighted linear problem; a caller
// repeats with new normals where the step is not small (Gauss-Newton).
// `valid` is false when too few normals agree, a direction is not determined, or the ellipse is
// thinner than a pixel. The weights left in `normals` tell which ones the fit kept.
FittedEllipse fit_ellipse(const Ellipse& start, std::vector<Normal>& normals,
                          const EllipsePrior* prior, double correlation_length) {
  FittedEllipse result{start, Matrix5::Zero(), false};
  for (Normal& n : normals) n.weight = n.found ? 1 : 0;
  if (normals.size() > kMostNormals) return result;
  Equations equations(normals);
  if (!equations.enough()) return result;
  const StepPrior known = prior_of(start, prior);
  Vector5 step = Vector5::Zero();
  for (int k = 0; k < kFitRounds; ++k) {
    equations.reweight(step, k < 3);
    Vector5 right;
    const Matrix5 seen = equations.information(correlation_length, right);
    const Eigen::LDLT<Matrix5> solver(seen + known.information);
    right += known.right;
    // A rim seen on one side only may leave a direction undetermined.
    const Vector5 pivots = solver.vectorD();
    equations.give_weights(normals);
    if (!equations.enough() || !(pivots.minCoeff() > 1e-9 * pivots.maxCoeff())) return result;
    step = solver.solve(right);
  }
  // The step holds center and shape; axes and angle follow from the shape's eigensystem.
  Eigen::Matrix2d shape = start.shape();
  shape += (Eigen::Matrix2d() << step[2], step[3], step[3], step[4]).finished();
  result.ellipse = Ellipse::from_shape(start.center_px + step.head<2>(), shape);
  if (!step.allFinite() || !(result.ellipse.semi_minor_px > 1)) return result;
  result.covariance = covariance_of(result.ellipse, equations, step, known, correlation_length);
  result.valid = result.covariance.allFinite();
  return result;
}

// sum (rho - 1) (1, cos, sin, cos 2, sin 2) = 0 where the ellipse is the unit circle and its points
// lie at rho: a normal's distance over the ellipse's own along the ray stands for rho - 1, at equal
// steps of the parameter, so that a caller's rounds end at the least-squares ellipse.
FittedEllipse fit_cornered(const Ellipse& start, std::vector<Normal>& normals) {
  FittedEllipse result{start, Matrix5::Zero(), false};
  Matrix5 sum = Matrix5::Zero();
  Vector5 right = Vector5::Zero();
  Matrix5 noise = Matrix5::Zero();
  std::size_t found = 0;
  for (Normal& n : normals) {
    n.weight = n.found ? 1 : 0;
    if (!n.found) continue;
    ++found;
    const Vector5 row = jacobian_row(n);
    // px along the normal for a growth of the radius by its own length
    const double reach = n.outward.dot(n.rim_px - start.center_px);
    const double w = 1 / (reach * reach);
    sum.noalias() += w * row * row.transpose();
    right.noalias() += w * n.shift_px * row;
    noise.noalias() += w * w * n.variance * row * row.transpose();
  }
  const Eigen::LDLT<Matrix5> solver(sum);
  const Vector5 pivots = solver.vectorD();
  if (2 * found < normals.size() || !(pivots.minCoeff() > 1e-9 * pivots.maxCoeff())) return result;
  const Vector5 step = solver.solve(right);
  Eigen::Matrix2d shape = start.shape();
  shape += (Eigen::Matrix2d() << step[2], step[3], step[3], step[4]).finished();
  result.ellipse = Ellipse::from_shape(start.center_px + step.head<2>(), shape);
  if (!step.allFinite() || !(result.ellipse.semi_minor_px > 1)) return result;
  const Matrix5 inverse = solver.solve(Matrix5::Identity());
  const Matrix5 j = axes_from_shape(result.ellipse, inverse * noise * inverse);
  result.covariance = j * (inverse * noise * inverse) * j.transpose();
  for (int k = 0; k < 4; ++k) result.covariance(k, k) += kSystematic * kSystematic;
  result.covariance = (result.covariance + result.covariance.transpose().eval()) / 2;
  result.valid = result.covariance.allFinite();
  return result;
}

// tau = 1 + 2 sum_k rho_k: the variance of a mean of n values with the autocorrelation rho is tau /
// n times that of one. Lags up to a sixth of the rim.
// 1 for independent errors. Summed up to the first lag without correlation, as the noise of the
// rest would only add up.
double integrated_autocorrelation(const std::vector<Normal>& normals) {
  const std::size_t count = normals.size();
  double mean = 0;
  double weights = 0;
  for (const Normal& n : normals)
    if (n.found) mean += n.weight * n.shift_px, weights += n.weight;
  if (!(weights > 0)) return 1;
  mean /= weights;
  // Residuals about their weighted mean; outliers have the weight 0.
  const auto off = [&](std::size_t k) { return normals[k].weight * (normals[k].shift_px - mean); };
  double sum = 1;
  for (std::size_t lag = 1; lag <= count / 6; ++lag) {
    double products = 0;
    double squares = 0;
    for (std::size_t k = 0; k < count; ++k) {
      const std::size_t next = (k + lag) % count;
      if (!normals[k].found || !normals[next].found) continue;
      products += off(k) * off(next);
      squares += (off(k) * off(k) + off(next) * off(next)) / 2;
    }
    if (!(products > 0) || !(squares > 0)) break;
    sum += 2 * products / squares;
  }
  return sum;
}

}  // namespace vitreo::vision
