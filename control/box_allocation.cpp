// SPDX-License-Identifier: Apache-2.0
#include "control/box_allocation.h"

#include "control/box_program.h"
#include "control/preconditions.h"
#include "control/wrench_rows.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/SVD>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace vitreo::control {
namespace {

constexpr int kMaxIterations = 48;  // never more than 25 in a million random wrenches
// of the reach: all of it would leave no field to hold the robot's axis
constexpr double kVerticalShare = 0.7;
// Weight of |I|^2 relative to the rows (Tikhonov): makes H positive definite where there are more
// coils than rows, and picks the least currents among those that make the same wrench.
constexpr double kRegularization = 1e-9;

constexpr double kLargestWeight = 1e9;

using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, 6, kMaxCoils>;
using Wanted = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, 6, 1>;

// Of the wrench: a larger miss is a limit's. The regularization costs less than that.
constexpr double kMissed = 1e-4;

// One allocation to solve: rows in T/A, wanted in T; the last row is the vertical force.
// Force rows are divided by |m| and multiplied by kGradientLength, so that all rows are fields and
// of one size.
struct Task {
  Rows rows;
  Wanted wanted;
  Wanted weight;
  double levitation = 0;  // the least of the last row
};

// Throws std::invalid_argument naming the argument, std::domain_error without a moment: a robot
// without one cannot be held at all.
void check(const FieldMatrix& matrix, const Eigen::Vector3d& moment, const FieldAndForce& wanted,
           const CurrentLimits& limits, const AllocationWeights& weights) {
  require(matrix.allFinite(), "matrix: not finite");
  require(moment.allFinite(), "moment: not finite");
  require(wanted.field.allFinite(), "wanted.field: not finite");
  require(wanted.levitation.allFinite(), "wanted.levitation: not finite");
  require(wanted.force.allFinite(), "wanted.force: not finite");
  require(limits.size() == matrix.cols() && limits.size() > 0, "limits: one a coil is needed");
  require(limits.allFinite() && limits.minCoeff() >= 0, "limits: must be at least 0 A");
  require(weights.field > 0 && weights.force > 0, "weights: must be above 0");
  // Their squares stand beside each other in one matrix.
  require(std::max(weights.field, weights.force) <= kLargestWeight, "weights: must be at most 1e9");
  if (!(moment.norm() > 0))
    throw std::domain_error("the robot has no moment: no force can be made");
}

// [B (3); F (3)]: the rows of A as in allocation.cpp, vertical force last.
// Weights are of the misses in T; the vertical row has none, as it is met exactly.
Task six_degrees(const FieldMatrix& matrix, const Eigen::Vector3d& moment,
                 const FieldAndForce& wanted, const AllocationWeights& weights) {
  const double scale = kGradientLength / moment.norm();
  Task task{Rows(6, matrix.cols()), Wanted(6), Wanted(6)};
  const Eigen::Matrix<double, 3, 5> force = scale * force_from_field(moment).rightCols<5>();
  for (Eigen::Index k = 0; k < matrix.cols(); ++k) {
    task.rows.col(k) << matrix.col(k).head<3>(), force * matrix.col(k).tail<5>();
  }
  task.wanted << wanted.field, scale * (wanted.levitation + wanted.force);
  task.weight << weights.field, weights.field, weights.field, weights.force, weights.force, 1;
  task.levitation = scale * wanted.levitation.z();
  return task;
}

// [T_perp (2); F (3)] (facts/magnetics 2). T = m x B, so the torque over |m| about u and v, two
// directions across the axis, is linear in the field; about the axis itself there is none.
// `torque` in N m; what of it lies along the axis falls out of both rows.
Task five_degrees(const FieldMatrix& matrix, const Eigen::Vector3d& moment,
                  const Eigen::Vector3d& torque, const FieldAndForce& wanted,
                  const AllocationWeights& weights) {
  const double size = moment.norm();
  const double scale = kGradientLength / size;
  const Eigen::Vector3d axis = moment / size;
  const Eigen::Vector3d u = axis.unitOrthogonal();
  const Eigen::Vector3d v = axis.cross(u);
  Task task{Rows(5, matrix.cols()), Wanted(5), Wanted(5)};
  const Eigen::Matrix<double, 3, 5> force = scale * force_from_field(moment).rightCols<5>();
  for (Eigen::Index k = 0; k < matrix.cols(); ++k) {
    const Eigen::Vector3d turning = axis.cross(matrix.col(k).head<3>());
    task.rows.col(k) << u.dot(turning), v.dot(turning), force * matrix.col(k).tail<5>();
  }
  task.wanted << u.dot(torque) / size, v.dot(torque) / size,
      scale * (wanted.levitation + wanted.force);
  task.weight << weights.field, weights.field, weights.force, weights.force, 1;
  task.levitation = scale * wanted.levitation.z();
  return task;
}

// I = A' (A A')^-1 w over the working coils; false where A A' has no full rank or a limit is
// exceeded. LDL' at the fixed size 6: a task of five rows is padded by one that asks for nothing.
// Where it returns false, `currents` is no solution.
bool least_norm(const Task& task, const CurrentLimits& limits, Currents& currents) {
  const Eigen::Index rows = task.rows.rows();
  Eigen::Matrix<double, 6, 6> gram = Eigen::Matrix<double, 6, 6>::Identity();
  gram.topLeftCorner(rows, rows).setZero();
  // Counted: of fewer coils than rows a pivot that is rounding alone may look like one that is not.
  if ((limits.array() > 0).count() < rows) return false;
  for (Eigen::Index k = 0; k < task.rows.cols(); ++k) {
    if (limits[k] == 0) continue;
    Eigen::Matrix<double, 6, 1> column = Eigen::Matrix<double, 6, 1>::Zero();
    column.head(rows) = task.rows.col(k);
    gram.noalias() += column * column.transpose();
  }
  if (rows == 5) gram(5, 5) = gram(0, 0);  // of the size of the others, so that no pivot is small
  const Eigen::LDLT<Eigen::Matrix<double, 6, 6>> solver(gram);
  const Eigen::Matrix<double, 6, 1> pivots = solver.vectorD();
  if (!(pivots.minCoeff() > kSmallestPivot * pivots.maxCoeff())) return false;
  Eigen::Matrix<double, 6, 1> w = Eigen::Matrix<double, 6, 1>::Zero();
  w.head(rows) = task.wanted;
  const Eigen::Matrix<double, 6, 1> x = solver.solve(w);
  currents.resize(task.rows.cols());
  bool fits = true;
  for (Eigen::Index k = 0; k < currents.size(); ++k) {
    currents[k] = limits[k] == 0 ? 0 : task.rows.col(k).dot(x.head(rows));
    fits = fits && std::abs(currents[k]) <= limits[k];
  }
  return fits;
}

// The vertical row's right-hand side: as wanted, or cut to kVerticalShare of the reach, but never
// below the levitation. `reach`: the largest a'I in the box, sum |a_k| limit_k.
// Throws std::domain_error where the levitation is out of reach. The bound leaves room for the
// field: at full reach every coil would stand at its limit.
double vertical_level(const Task& task, double reach, bool& cut) {
  const double wanted = task.wanted[task.wanted.size() - 1];
  if (std::abs(task.levitation) > reach * (1 + 1e-12)) {
    throw std::domain_error(
        "holding the robot against its weight alone is beyond the current limit here");
  }
  const double most = std::max(std::abs(task.levitation), kVerticalShare * reach);
  cut = std::abs(wanted) > most;
  return cut ? std::copysign(most, wanted) : wanted;
}

// min 1/2 I'HI - c'I with H = sum w_r^2 a_r a_r' + eps 1 and c = sum w_r^2 b_r a_r over all rows
// but the last, which becomes the equality a'I = level: the normal equations of the weighted
// misses.
// Padded to kMaxUnknowns; only the first `size` entries count.
BoxProgram program_of(const Task& task, const CurrentLimits& limits) {
  const int n = static_cast<int>(limits.size());
  const Eigen::Index soft = task.rows.rows() - 1;
  BoxProgram program;
  program.size = n;
  program.curvature.setZero();
  program.slope.setZero();
  program.plane.setZero();
  program.limit.setZero();
  program.limit.head(n) = limits;
  program.plane.head(n) = task.rows.row(soft).transpose();
  double trace = 0;
  for (Eigen::Index r = 0; r < soft; ++r) {
    const double weight = task.weight[r] * task.weight[r];
    const Eigen::Matrix<double, kMaxUnknowns, 1> row = [&] {
      Eigen::Matrix<double, kMaxUnknowns, 1> padded =
          Eigen::Matrix<double, kMaxUnknowns, 1>::Zero();
      padded.head(n) = task.rows.row(r).transpose();
      return padded;
    }();
    program.curvature.noalias() += weight * row * row.transpose();
    program.slope += weight * task.wanted[r] * row;
    trace += weight * row.squaredNorm();
  }
  program.curvature.diagonal().array() +=
      std::max(kRegularization * trace, std::numeric_limits<double>::min());
  return program;
}

// The least-norm solution where it fits; else the quadratic program.
// The usual tick ends in the first line. `iterations` tells from outside whether a limit was met.
BoxAllocation solve(const Task& task, const CurrentLimits& limits) {
  BoxAllocation result;
  if (least_norm(task, limits, result.currents)) return result;
  const Eigen::Index n = limits.size();
  const auto plane = task.rows.row(task.rows.rows() - 1);
  double reach = 0;
  for (Eigen::Index k = 0; k < n; ++k) reach += std::abs(plane[k]) * limits[k];
  const double level = vertical_level(task, reach, result.vertical_cut);
  const BoxProgram program = program_of(task, limits);
  // A feasible start: each coil takes its part of the vertical force in proportion to its limit,
  // I_k = sgn(a_k) limit_k level / reach. It lies in the box, and a'I = level.
  Eigen::Matrix<double, kMaxUnknowns, 1> x = Eigen::Matrix<double, kMaxUnknowns, 1>::Zero();
  // Without any reach the level is 0, and so is the start.
  const double share = reach > 0 ? std::clamp(level / reach, -1.0, 1.0) : 0;
  for (Eigen::Index k = 0; k < n; ++k) x[k] = std::copysign(share * limits[k], share * plane[k]);
  result.iterations = improve(program, x, kMaxIterations);
  result.currents = x.head(n).cwiseMin(limits).cwiseMax(-limits);
  const Wanted missed = task.rows * result.currents - task.wanted;
  result.limited = missed.norm() > kMissed * task.wanted.norm();
  return result;
}

// Adds the field and force that the currents make, and the headroom that they leave.
// The force is that of the moment given; a soft robot's moment at the field made may be smaller,
// which the caller iterates.
BoxAllocation reported(BoxAllocation result, const FieldMatrix& matrix,
                       const Eigen::Vector3d& moment, const CurrentLimits& limits) {
  FieldGradient made = FieldGradient::Zero();
  for (Eigen::Index k = 0; k < limits.size(); ++k) {
    made += result.currents[k] * matrix.col(k);
    if (limits[k] > 0)
      result.headroom = std::min(result.headroom, 1 - std::abs(result.currents[k]) / limits[k]);
  }
  result.field = made.head<3>();
  result.force = force_from_field(moment) * made;
  return result;
}

}  // namespace

BoxAllocation allocate_within(const FieldMatrix& matrix, const Eigen::Vector3d& moment,
                              const FieldAndForce& wanted, const CurrentLimits& limits,
                              const AllocationWeights& weights) {
  check(matrix, moment, wanted, limits, weights);
  return reported(solve(six_degrees(matrix, moment, wanted, weights), limits), matrix, moment,
                  limits);
}

BoxAllocation allocate_five_degrees(const FieldMatrix& matrix, const Eigen::Vector3d& moment,
                                    const Eigen::Vector3d& torque, const FieldAndForce& wanted,
                                    const CurrentLimits& limits, const AllocationWeights& weights) {
  check(matrix, moment, wanted, limits, weights);
  require(torque.allFinite(), "torque: not finite");
  return reported(solve(five_degrees(matrix, moment, torque, wanted, weights), limits), matrix,
                  moment, limits);
}

// Infinite where a degree of freedom is lost; coils with the limit 0 do not count.
double condition_number(const FieldMatrix& matrix, const Eigen::Vector3d& moment,
                        const CurrentLimits& limits) {
  check(matrix, moment, {}, limits, {});
  Rows rows = six_degrees(matrix, moment, {}, {}).rows;
  for (Eigen::Index k = 0; k < limits.size(); ++k) {
    if (limits[k] == 0) rows.col(k).setZero();
  }
  // The singular values of A are the roots of those of A A', which is 6 x 6 for any number of
  // coils.
  const Eigen::Matrix<double, 6, 6> gram = rows * rows.transpose();
  const Eigen::Matrix<double, 6, 1> s =
      Eigen::JacobiSVD<Eigen::Matrix<double, 6, 6>>(gram).singularValues();
  // These are squares: below 1e-15 of the largest there is only rounding.
  return s[5] > 1e-15 * s[0] ? std::sqrt(s[0] / s[5]) : std::numeric_limits<double>::infinity();
}

}  // namespace vitreo::control
