// SPDX-License-Identifier: Apache-2.0
#include "optics/calibration/retina_shape.h"

#include "optics/numerics/preconditions.h"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

namespace vitreo::optics {
namespace {

using Parameters = Eigen::Matrix<double, 5, 1>;  // x0, y0, z0, R, k
using Normal = Eigen::Matrix<double, 5, 5>;

/// Indices into (x0, y0, z0, R, k): R and the depth z0 are always free.
/// The retina is x, y, z on a conic of revolution about an axis parallel to z: (x0, y0, z0) its
/// vertex, R and k as in (3.1).
std::vector<int> free_parameters(const RetinaFitOptions& options) {
  std::vector<int> free;
  if (options.fit_center) free = {0, 1};
  free.insert(free.end(), {2, 3});
  if (options.fit_conic) free.push_back(4);
  return free;
}

/// Distance to first order (Sampson 1982): F / |grad F| with F = r^2 - 2 R w + (1+k) w^2, and its
/// derivatives with |grad F| held: enough for least squares of small distances.
/// At the conic's center F has no gradient; points lie on the shell, far from there.
double distance(const Parameters& p, const Eigen::Vector3d& point, Parameters& by) {
  const double x = point.x() - p[0];
  const double y = point.y() - p[1];
  const double w = point.z() - p[2];
  const double along = -2 * p[3] + 2 * (1 + p[4]) * w;
  const double f = x * x + y * y - 2 * p[3] * w + (1 + p[4]) * w * w;
  const double gradient = std::sqrt(4 * (x * x + y * y) + along * along);
  by << -2 * x, -2 * y, -along, -2 * w, w * w;
  by /= gradient;
  return f / gradient;
}

[[noreturn]] void refuse(const char* why) {
  throw std::invalid_argument(std::string("points: ") + why);
}

/// Algebraic start: r^2 = 2 R w - (1+k) w^2 is linear in the coefficients of 1, x, y, z, z^2. It
/// minimizes F instead of the distance, so it is biased with noise, but needs no start.
/// Lengths in units of `scale`, so that the columns are of like size and the test of the singular
/// values has a meaning.
Parameters algebraic(std::span<const Eigen::Vector3d> points, const RetinaFitOptions& options,
                     double scale) {
  const Eigen::Index count = static_cast<Eigen::Index>(points.size());
  const Eigen::Index columns = 2 + (options.fit_center ? 2 : 0) + (options.fit_conic ? 1 : 0);
  Eigen::MatrixXd design(count, columns);
  Eigen::VectorXd right(count);
  for (Eigen::Index i = 0; i < count; ++i) {
    const Eigen::Vector3d q = points[static_cast<std::size_t>(i)] / scale;
    Eigen::Index column = 0;
    design(i, column++) = 1;
    design(i, column++) = q.z();
    if (options.fit_center) {
      design(i, column++) = q.x();
      design(i, column++) = q.y();
    }
    right[i] = q.x() * q.x() + q.y() * q.y();
    if (options.fit_conic) {
      design(i, column++) = q.z() * q.z();
    } else {
      right[i] += (1 + options.conic) * q.z() * q.z();
    }
  }
  // least over largest singular value; noise of 1 um is above it
  constexpr double kDetermined = 1e-7;
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(design, Eigen::ComputeThinU | Eigen::ComputeThinV);
  const auto& values = svd.singularValues();
  if (!(values[columns - 1] > kDetermined * values[0]))
    refuse("they do not determine the surface (degenerate)");
  const Eigen::VectorXd c = svd.solve(right);
  // The center completes the squares of r^2 - 2 x0 x - 2 y0 y.
  const double x0 = options.fit_center ? c[2] / 2 : 0;
  const double y0 = options.fit_center ? c[3] / 2 : 0;
  const double squared = options.fit_conic ? c[columns - 1] : -(1 + options.conic);  // -(1+k)
  // r^2 about the center = a + b z - (1+k) z^2; the vertex is its zero on the side where it grows.
  // Completing the squares of x and y moves their constants into a.
  const double a = c[0] + x0 * x0 + y0 * y0;
  const double b = c[1];
  const double discriminant = b * b - 4 * squared * a;
  if (!(discriminant > 0)) refuse("no surface concave towards +z fits them");
  const double root = std::sqrt(discriminant);
  // The slope of r^2 at the vertex is 2R, which this discriminant's root is.
  const double z0 = b + root > 0 ? -2 * a / (b + root) : (root - b) / (2 * squared);
  return Parameters(x0 * scale, y0 * scale, z0 * scale, root / 2 * scale,
                    options.fit_conic ? -squared - 1 : options.conic);
}

/// J^T J, J^T r and the residuals of one pass.
struct State {
  Normal matrix = Normal::Zero();
  Parameters vector = Parameters::Zero();
  double squares = 0;
  double largest = 0;
};

/// Normal equations of the distances.
State linearize(const Parameters& p, std::span<const Eigen::Vector3d> points, double scale) {
  State state;
  for (const Eigen::Vector3d& point : points) {
    Parameters by;
    const double d = distance(p, point, by);
    by[4] /= scale;  // the conic constant counts in units of 1, all else in units of `scale`
    state.matrix += by * by.transpose();
    state.vector -= by * d;
    state.squares += d * d;
    state.largest = std::max(state.largest, std::abs(d));
  }
  return state;
}

/// Inverse over the free parameters; zero where a parameter is held.
/// Held parameters are struck out before the inversion: one that is known has no variance and lends
/// none to others.
Normal inverse_of(const Normal& matrix, const std::vector<int>& free) {
  const auto n = static_cast<Eigen::Index>(free.size());
  Eigen::MatrixXd reduced = matrix(free, free);
  Normal inverse = Normal::Zero();
  const Eigen::MatrixXd small = reduced.ldlt().solve(Eigen::MatrixXd::Identity(n, n));
  inverse(free, free) = small;
  return inverse;
}

/// Throws std::invalid_argument naming `points` or `conic`; the degenerate positions show only in
/// the fit itself.
void check(std::span<const Eigen::Vector3d> points, const RetinaFitOptions& options,
           std::size_t needed) {
  detail::require_finite(options.conic, "conic");
  if (points.size() < needed) refuse("too few for the parameters that are free");
  for (const Eigen::Vector3d& point : points) {
    if (!point.allFinite()) refuse("must be finite");
  }
}

}  // namespace

/// Gauss-Newton from the algebraic fit.
/// Held ones of the five parameters keep their value through all steps. Refused when the points lie
/// on the far cap or the fit turns convex, as a retina is concave towards the lens.
RetinaFit fit_retina(std::span<const Eigen::Vector3d> points, const RetinaFitOptions& options) {
  constexpr int kSteps = 50;
  constexpr double kSmall = 1e-12;  // of the conic constant, and of lengths in units of `scale`
  const std::vector<int> free = free_parameters(options);
  check(points, options, free.size());
  double scale = 0;
  for (const Eigen::Vector3d& point : points)
    scale = std::max(scale, (point - points.front()).norm());
  if (!(scale > 1e-9)) refuse("all lie in one place");
  Parameters p = algebraic(points, options, scale);
  for (int i = 0; i < kSteps; ++i) {
    const State state = linearize(p, points, scale);
    Parameters step = inverse_of(state.matrix, free) * state.vector;
    if (!step.allFinite()) refuse("they do not determine the surface");
    const bool converged = step.norm() < kSmall * scale;  // here k still counts in `scale`
    step[4] /= scale;
    p += step;
    if (converged) break;
  }
  // A sphere also passes through points on its far cap, where it is concave the other way.
  const auto on_sheet = [&](const Eigen::Vector3d& point) {
    return (1 + p[4]) * (point.z() - p[2]) < p[3];
  };
  if (!p.allFinite() || !(p[3] > 0) || !std::all_of(points.begin(), points.end(), on_sheet)) {
    refuse("no surface concave towards +z fits them");
  }
  const State state = linearize(p, points, scale);
  RetinaFit fit{p.head<3>(),   p[3],
                p[4],          std::sqrt(state.squares / static_cast<double>(points.size())),
                state.largest, {}};
  fit.covariance.setZero();
  if (points.size() > free.size()) {
    // (J^T J)^-1 times the residual variance; k was counted in units of `scale`.
    fit.covariance = inverse_of(state.matrix, free) *
                     (state.squares / static_cast<double>(points.size() - free.size()));
    fit.covariance.row(4) /= scale;
    fit.covariance.col(4) /= scale;
  }
  return fit;
}

}  // namespace vitreo::optics
