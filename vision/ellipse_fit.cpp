// SPDX-License-Identifier: Apache-2.0
#include "vision/ellipse_fit.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace vitreo::vision {
namespace {

using Vector5 = Eigen::Matrix<double, 5, 1>;
using Matrix5 = Eigen::Matrix<double, 5, 5>;

constexpr int kReweightings = 6;
constexpr double kTukey = 4.685;        // the usual 95 % efficiency
constexpr double kSmallestScale = 0.1;  // px: below it nothing is an outlier
constexpr double kFloor = 0.05;         // px: what the model of a rim may miss at one normal
constexpr double kSystematic = 0.02;    // px: what it may miss all round
constexpr double kFewest = 0.35;        // of the normals, that must agree
constexpr std::size_t kMostNormals = 1024;

// How the rim's distance along a normal follows center and shape matrix (xx, xy, yy).
Vector5 row_of(const Normal& n) {
  Vector5 row;
  row << n.outward, n.outward.x() * n.circle.x(),
      n.outward.x() * n.circle.y() + n.outward.y() * n.circle.x(), n.outward.y() * n.circle.y();
  return row;
}

double weight_of(const Normal& n) { return n.weight / (n.variance + kFloor * kFloor); }

Matrix5 information(const std::vector<Normal>& normals, double together, Vector5* right) {
  Matrix5 sum = Matrix5::Zero();
  if (right != nullptr) right->setZero();
  for (const Normal& n : normals) {
    if (!n.found || n.weight <= 0) continue;
    const Vector5 row = row_of(n);
    const double w = weight_of(n) / together;
    sum.noalias() += w * row * row.transpose();
    if (right != nullptr) *right += w * n.shift_px * row;
  }
  return sum;
}

// Median absolute deviation, as a standard deviation.
double scale_of(const std::vector<Normal>& normals, const Vector5& step) {
  std::array<double, kMostNormals> off{};  // on the stack: nothing is allocated per image
  auto end = off.begin();
  for (const Normal& n : normals) {
    if (n.found) *end++ = std::abs(n.shift_px - row_of(n).dot(step));
  }
  const auto middle = off.begin() + (end - off.begin()) / 2;
  std::nth_element(off.begin(), middle, end);
  return std::max(1.4826 * *middle, kSmallestScale);
}

void reweigh(std::vector<Normal>& normals, const Vector5& step, bool gently) {
  const double scale = scale_of(normals, step);
  for (Normal& n : normals) {
    if (!n.found) continue;
    const double off = std::abs(n.shift_px - row_of(n).dot(step)) / scale;
    const double inside = 1 - off * off / (kTukey * kTukey);
    // The first rounds keep a say for all (Cauchy), else a bad start would lock in.
    n.weight = gently ? 1 / (1 + off * off) : (inside > 0 ? inside * inside : 0);
  }
}

// Derivatives of (u, v, a, b, angle) by (u, v, Sxx, Sxy, Syy). Where the axes are alike the angle
// becomes "anything", a uniform pi wide, instead of dividing by nothing.
Matrix5 axes_from_shape(const Ellipse& ellipse, const Matrix5& covariance) {
  const double c = std::cos(ellipse.angle), s = std::sin(ellipse.angle);
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

// A prior as the fit counts: of the step in (u, v, Sxx, Sxy, Syy) from `start`.
struct StepPrior {
  Matrix5 information = Matrix5::Zero();
  Vector5 right = Vector5::Zero();
};

StepPrior prior_of(const Ellipse& start, const EllipsePrior* prior) {
  StepPrior result;
  if (prior == nullptr) return result;
  const double c = std::cos(prior->ellipse.angle), s = std::sin(prior->ellipse.angle);
  Matrix5 j = Matrix5::Zero();  // (u, v, a, b, turn times difference of the axes) by the step
  j(0, 0) = j(1, 1) = 1;
  j.row(2).tail<3>() << c * c, 2 * c * s, s * s;
  j.row(3).tail<3>() << s * s, -2 * c * s, c * c;
  j.row(4).tail<3>() << -c * s, c * c - s * s, c * s;
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

Matrix5 covariance_of(const Ellipse& ellipse, const std::vector<Normal>& normals,
                      const Vector5& step, const StepPrior& prior, double together) {
  double squares = 0, count = 0;
  for (const Normal& n : normals) {
    if (!n.found || n.weight <= 0) continue;
    const double off = n.shift_px - row_of(n).dot(step);
    squares += weight_of(n) * off * off;
    count += n.weight;
  }
  const double residual = std::max(squares / std::max(count - 5, 1.0), 0.25);
  const Matrix5 shape =
      (information(normals, together, nullptr) / residual + prior.information).inverse();
  const Matrix5 j = axes_from_shape(ellipse, shape);
  Matrix5 result = j * shape * j.transpose();
  for (int k = 0; k < 4; ++k) result(k, k) += kSystematic * kSystematic;
  return (result + result.transpose()) / 2;
}

bool enough(const std::vector<Normal>& normals) {
  const auto agree = [](const Normal& n) { return n.found && n.weight > 0; };
  const auto count = static_cast<double>(std::count_if(normals.begin(), normals.end(), agree));
  return count >= std::max(kFewest * static_cast<double>(normals.size()), 8.0);
}

}  // namespace

void place_normals(const Ellipse& ellipse, std::vector<Normal>& normals) {
  const Eigen::Matrix2d shape = ellipse.shape(), inverse = shape.inverse();
  for (std::size_t k = 0; k < normals.size(); ++k) {
    const double t =
        2 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(normals.size());
    Normal& n = normals[k];
    n = Normal{};
    n.circle = {std::cos(t + ellipse.angle), std::sin(t + ellipse.angle)};
    n.rim_px = ellipse.center_px + shape * n.circle;
    n.outward = (inverse * n.circle).normalized();
  }
}

FittedEllipse fit_ellipse(const Ellipse& start, std::vector<Normal>& normals,
                          const EllipsePrior* prior, double together) {
  FittedEllipse result{start, Matrix5::Zero(), false};
  for (Normal& n : normals) n.weight = n.found ? 1 : 0;
  if (!enough(normals) || normals.size() > kMostNormals) return result;
  const StepPrior known = prior_of(start, prior);
  Vector5 step = Vector5::Zero();
  for (int k = 0; k < kReweightings; ++k) {
    reweigh(normals, step, k < 3);
    Vector5 right;
    const Matrix5 seen = information(normals, together, &right);
    const Eigen::LDLT<Matrix5> solver(seen + known.information);
    right += known.right;
    const Vector5 pivots = solver.vectorD();
    if (!enough(normals) || !(pivots.minCoeff() > 1e-9 * pivots.maxCoeff())) return result;
    step = solver.solve(right);
  }
  Eigen::Matrix2d shape = start.shape();
  shape += (Eigen::Matrix2d() << step[2], step[3], step[3], step[4]).finished();
  result.ellipse = Ellipse::from_shape(start.center_px + step.head<2>(), shape);
  if (!step.allFinite() || !(result.ellipse.semi_minor_px > 1)) return result;
  result.covariance = covariance_of(result.ellipse, normals, step, known, together);
  result.valid = result.covariance.allFinite();
  return result;
}

double error_correlation(const std::vector<Normal>& normals) {
  const std::size_t count = normals.size();
  double mean = 0, weights = 0;
  for (const Normal& n : normals)
    if (n.found) mean += n.weight * n.shift_px, weights += n.weight;
  if (!(weights > 0)) return 1;
  mean /= weights;
  const auto off = [&](std::size_t k) { return normals[k].weight * (normals[k].shift_px - mean); };
  double sum = 1;
  for (std::size_t lag = 1; lag <= count / 6; ++lag) {
    double products = 0, squares = 0;
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
