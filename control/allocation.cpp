// SPDX-License-Identifier: Apache-2.0
#include "control/allocation.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>

namespace vitreo::control {
namespace {

using Wrench = Eigen::Matrix<double, 6, 1>;  // field, T; force over moment times kGradientLength, T
using WrenchMatrix = Eigen::Matrix<double, 6, Eigen::Dynamic, Eigen::ColMajor, 6, kMaxCoils>;

// Makes rows of gradient comparable with rows of field: about the distance over which the coils'
// field falls by half.
constexpr double kGradientLength = 20e-3;
// Of the pivots of A A'. Inside the workspace the condition of A stays below 13, so its square
// below 170; a rank lost shows as rounding, 1e-16. Beyond 1e-10 the currents would be ten thousand
// times those of a good pose.
constexpr double kSmallestPivot = 1e-10;

void check(const FieldMatrix& matrix, const Eigen::Vector3d& moment, const FieldAndForce& wanted,
           double limit) {
  if (!matrix.allFinite()) throw std::invalid_argument("matrix: not finite");
  if (!moment.allFinite()) throw std::invalid_argument("moment: not finite");
  if (!wanted.field.allFinite()) throw std::invalid_argument("wanted.field: not finite");
  if (!wanted.levitation.allFinite()) throw std::invalid_argument("wanted.levitation: not finite");
  if (!wanted.force.allFinite()) throw std::invalid_argument("wanted.force: not finite");
  if (!std::isfinite(limit) || limit <= 0)
    throw std::invalid_argument("limit: must be finite and above 0 A");
}

// I = A' (A A')^-1 w: the least-norm solution.
class LeastNorm {
 public:
  LeastNorm(const FieldMatrix& matrix, const Eigen::Vector3d& moment)
      : per_moment_(kGradientLength / moment.norm()) {
    if (!std::isfinite(per_moment_))
      throw std::domain_error("the robot has no moment: no force can be made");
    if (matrix.cols() < 6) throw std::domain_error("field and force need at least six coils");
    const Eigen::Matrix<double, 3, 5> force = per_moment_ * force_from_field(moment).rightCols<5>();
    matrix_.resize(6, matrix.cols());
    Eigen::Matrix<double, 6, 6> gram = Eigen::Matrix<double, 6, 6>::Zero();
    for (Eigen::Index k = 0; k < matrix.cols(); ++k) {
      Wrench column;
      column << matrix.col(k).head<3>(), force * matrix.col(k).tail<5>();
      matrix_.col(k) = column;
      gram.noalias() += column * column.transpose();
    }
    solver_.compute(gram);
    const Wrench pivots = solver_.vectorD();
    if (!(pivots.minCoeff() > kSmallestPivot * pivots.maxCoeff())) {
      throw std::domain_error("the coils cannot make field and force independently here");
    }
  }

  Currents operator()(const Eigen::Vector3d& field, const Eigen::Vector3d& force) const {
    Wrench w;
    w << field, per_moment_ * force;
    const Wrench x = solver_.solve(w);
    Currents currents(matrix_.cols());
    for (Eigen::Index k = 0; k < matrix_.cols(); ++k) currents[k] = matrix_.col(k).dot(x);
    return currents;
  }

 private:
  double per_moment_;  // m / (A m^2)
  WrenchMatrix matrix_;
  Eigen::LDLT<Eigen::Matrix<double, 6, 6>> solver_;
};

// The largest s in [0, 1] with |fixed + s scaled| <= limit in every coil, or nothing.
std::optional<double> largest_scale(const Currents& fixed, const Currents& scaled, double limit) {
  double low = 0, high = 1;
  for (Eigen::Index k = 0; k < fixed.size(); ++k) {
    if (scaled[k] == 0) {
      if (std::abs(fixed[k]) > limit) return std::nullopt;
      continue;
    }
    const double a = (-limit - fixed[k]) / scaled[k], b = (limit - fixed[k]) / scaled[k];
    low = std::max(low, std::min(a, b));
    high = std::min(high, std::max(a, b));
  }
  if (low > high) return std::nullopt;
  return high;
}

bool within(const Currents& currents, double limit) {
  return currents.cwiseAbs().maxCoeff() <= limit;
}

// A current that a scale has brought to its limit may stand a rounding beyond it.
Currents rounded_within(const Currents& currents, double limit) {
  return currents.cwiseMin(limit).cwiseMax(-limit);
}

Allocation within_limit(const LeastNorm& solve, const FieldAndForce& wanted, double limit) {
  const Eigen::Vector3d none = Eigen::Vector3d::Zero();
  const Currents levitation = solve(none, wanted.levitation);
  const Currents field = solve(wanted.field, none);
  const Currents force = solve(none, wanted.force);
  if (const auto scale = largest_scale(levitation + field, force, limit)) {
    return {rounded_within(levitation + field + *scale * force, limit), *scale, 1};
  }
  if (const auto scale = largest_scale(levitation, field, limit)) {
    return {rounded_within(levitation + *scale * field, limit), 0, *scale};
  }
  throw std::domain_error(
      "holding the robot against its weight alone is beyond the current limit here");
}

}  // namespace

Allocation allocate(const FieldMatrix& matrix, const Eigen::Vector3d& moment,
                    const FieldAndForce& wanted, double limit) {
  check(matrix, moment, wanted, limit);
  const LeastNorm solve(matrix, moment);
  const Currents currents = solve(wanted.field, wanted.levitation + wanted.force);
  if (within(currents, limit)) return {currents, 1, 1};
  return within_limit(solve, wanted, limit);
}

}  // namespace vitreo::control
