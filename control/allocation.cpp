// SPDX-License-Identifier: Apache-2.0
#include "control/allocation.h"

#include "control/preconditions.h"
#include "control/wrench_rows.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>

namespace vitreo::control {
namespace {

using Wrench = Eigen::Matrix<double, 6, 1>;  // field, T; force over moment times kGradientLength, T
using WrenchMatrix = Eigen::Matrix<double, 6, Eigen::Dynamic, Eigen::ColMajor, 6, kMaxCoils>;

// Throws std::invalid_argument naming the argument: a NaN would come out as a current.
void check(const FieldMatrix& matrix, const Eigen::Vector3d& moment, const FieldAndForce& wanted,
           double limit) {
  require(matrix.allFinite(), "matrix: not finite");
  require(moment.allFinite(), "moment: not finite");
  require(wanted.field.allFinite(), "wanted.field: not finite");
  require(wanted.levitation.allFinite(), "wanted.levitation: not finite");
  require(wanted.force.allFinite(), "wanted.force: not finite");
  require(positive(limit), "limit: must be finite and above 0 A");
}

// The right pseudo-inverse (Moore & Penrose) of A = [A_b; S(m) A_g], the matrix from currents to
// field and force (Kummer et al. 2010; facts/magnetics 2): I = A' (A A')^-1 w has the least |I|^2,
// so the least heat, of all currents that make the wrench w.
// Factorized once and solved for several wrenches. Throws std::domain_error where a degree of
// freedom is lost.
class LeastNorm {
 public:
  LeastNorm(const FieldMatrix& matrix, const Eigen::Vector3d& moment)
      : per_moment_(kGradientLength / moment.norm()) {
    if (!std::isfinite(per_moment_))
      throw std::domain_error("the robot has no moment: no force can be made");
    if (matrix.cols() < 6) throw std::domain_error("field and force need at least six coils");
    // S(m): the first three columns of force_from_field, which belong to the field, are zero.
    const Eigen::Matrix<double, 3, 5> force = per_moment_ * force_from_field(moment).rightCols<5>();
    matrix_.resize(6, matrix.cols());
    // A A' as a sum of outer products: one pass over the columns, at a fixed size.
    Eigen::Matrix<double, 6, 6> gram = Eigen::Matrix<double, 6, 6>::Zero();
    int working = 0;
    for (Eigen::Index k = 0; k < matrix.cols(); ++k) {
      Wrench column;
      column << matrix.col(k).head<3>(), force * matrix.col(k).tail<5>();
      matrix_.col(k) = column;
      working += column.isZero(0) ? 0 : 1;
      gram.noalias() += column * column.transpose();
    }
    // LDL' with pivoting: D shows a lost rank. It squares the condition, which the scaled rows keep
    // below 13, and costs 0.5 us where a singular value decomposition costs 16 (facts/magnetics 4).
    solver_.compute(gram);
    const Wrench pivots = solver_.vectorD();
    // Counted too: of fewer coils a pivot that is rounding alone may look like one that is not.
    if (working < 6 || !(pivots.minCoeff() > kSmallestPivot * pivots.maxCoeff())) {
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

// The largest s in [0, 1] with |fixed + s scaled| <= limit in every coil, or nothing: each coil
// allows an interval of s, and these are intersected.
// 1 when nothing needs to be cut. `fixed` alone may be beyond the limit and still be brought back
// by a part of `scaled`.
std::optional<double> largest_scale(const Currents& fixed, const Currents& scaled, double limit) {
  double low = 0;
  double high = 1;
  for (Eigen::Index k = 0; k < fixed.size(); ++k) {
    if (scaled[k] == 0) {
      if (std::abs(fixed[k]) > limit) return std::nullopt;
      continue;
    }
    const double a = (-limit - fixed[k]) / scaled[k];
    const double b = (limit - fixed[k]) / scaled[k];
    low = std::max(low, std::min(a, b));
    high = std::min(high, std::max(a, b));
  }
  // Some coil allows no share that the others allow.
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

// The least-norm solution is linear in the wrench, so its parts can be scaled each on its own:
// first the extra force, then the field's magnitude, never the levitation. (Scaling all currents
// alike would let the robot fall, and clipping each would turn the wrench: facts/magnetics 2.)
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

// Without a limit in the way one solve suffices; only then are the parts of the wrench taken apart.
Allocation allocate(const FieldMatrix& matrix, const Eigen::Vector3d& moment,
                    const FieldAndForce& wanted, double limit) {
  check(matrix, moment, wanted, limit);
  const LeastNorm solve(matrix, moment);
  const Currents currents = solve(wanted.field, wanted.levitation + wanted.force);
  if (within(currents, limit)) return {currents, 1, 1};
  return within_limit(solve, wanted, limit);
}

}  // namespace vitreo::control
