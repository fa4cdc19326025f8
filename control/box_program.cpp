// SPDX-License-Identifier: Apache-2.0
#include "control/box_program.h"

#include <array>
#include <cmath>
#include <limits>

namespace vitreo::control {
namespace {

using Vector8 = Eigen::Matrix<double, kMaxUnknowns, 1>;

// The step p of the free unknowns F to the minimum on the plane, from the Karush-Kuhn-Tucker system
// H_FF p = g_F - nu a_F, a_F'p = 0, where g = c - H x is downhill. By the Schur complement (Nocedal
// & Wright 2006, 16.2): with H_FF = L L' (Cholesky), y = L^-1 g_F and t = L^-1 a_F, the multiplier
// is nu = t'y / t't and p = L'^-1 (y - nu t).
// The free unknowns alone are factorized: the others stand at their bounds and have no step.
class FreeStep {
 public:
  FreeStep(const BoxProgram& program, const std::array<int, kMaxUnknowns>& free, int count,
           const Vector8& downhill)
      : count_(count) {
    for (int i = 0; i < count; ++i) {
      for (int j = 0; j <= i; ++j) factor_[i][j] = program.curvature(free[i], free[j]);
      step_[i] = downhill[free[i]];
      across_[i] = program.plane[free[i]];
    }
    factorize();
    forward(step_);
    forward(across_);
    double mixed = 0;
    double square = 0;
    for (int i = 0; i < count; ++i) {
      mixed += across_[i] * step_[i];
      square += across_[i] * across_[i];
    }
    // Where no free unknown moves the level, a_F = 0 and the equality holds whatever p is.
    moves_level_ = square > 0;
    plane_force_ = moves_level_ ? mixed / square : 0;
    for (int i = 0; i < count; ++i) step_[i] -= plane_force_ * across_[i];
    backward(step_);
  }

  double operator[](int i) const { return step_[i]; }
  double plane_force() const { return plane_force_; }
  bool moves_level() const { return moves_level_; }

 private:
  // Cholesky in place, row by row, with the diagonal kept as its inverse: at most 8 x 8, so plain
  // loops cost less than a library's dispatch.
  void factorize() {
    for (int i = 0; i < count_; ++i) {
      for (int j = 0; j <= i; ++j) {
        double sum = factor_[i][j];
        for (int k = 0; k < j; ++k) sum -= factor_[i][k] * factor_[j][k];
        factor_[i][j] = i == j ? sum : sum * inverse_[j];
      }
      inverse_[i] = 1 / std::sqrt(factor_[i][i]);
    }
  }
  // v := L^-1 v.
  void forward(double* v) const {
    for (int i = 0; i < count_; ++i) {
      for (int k = 0; k < i; ++k) v[i] -= factor_[i][k] * v[k];
      v[i] *= inverse_[i];
    }
  }
  // v := L'^-1 v.
  void backward(double* v) const {
    for (int i = count_ - 1; i >= 0; --i) {
      for (int k = i + 1; k < count_; ++k) v[i] -= factor_[k][i] * v[k];
      v[i] *= inverse_[i];
    }
  }

  int count_;
  double plane_force_ = 0;
  bool moves_level_ = false;
  double factor_[kMaxUnknowns][kMaxUnknowns];
  double inverse_[kMaxUnknowns];
  double step_[kMaxUnknowns];
  double across_[kMaxUnknowns];
};

// Goes the step as far as the box lets: the ratio test, the longest part of the step, and the bound
// that it meets. That unknown is exactly on it then and joins the working set.
bool meets_bound(const BoxProgram& program, const std::array<int, kMaxUnknowns>& free, int count,
                 const FreeStep& step, Vector8& x, std::array<int, kMaxUnknowns>& held) {
  double reach = 1;
  int hit = -1;
  for (int i = 0; i < count; ++i) {
    const int k = free[i];
    const double room = (step[i] > 0 ? program.limit[k] : -program.limit[k]) - x[k];
    if (std::abs(step[i]) * reach > std::abs(room)) reach = room / step[i], hit = i;
  }
  for (int i = 0; i < count; ++i) x[free[i]] += reach * step[i];
  if (hit < 0) return false;
  const int k = free[hit];
  held[k] = step[hit] > 0 ? 1 : -1;
  x[k] = held[k] * program.limit[k];
  return true;
}

// The plane's multipliers that hold every unknown at its bound, where none that is free moves the
// level: g = c - H x, and h (g - nu a) >= 0 of each bound h. `at_least` and `at_most` are the
// unknowns that bound nu, -1 for none.
struct PlaneForces {
  int at_least = -1;
  int at_most = -1;
  double from = -std::numeric_limits<double>::infinity();
  double to = std::numeric_limits<double>::infinity();

  double middle() const {
    if (at_least < 0 || at_most < 0) return at_least >= 0 ? from : at_most >= 0 ? to : 0;
    return (from + to) / 2;
  }
};

PlaneForces plane_forces(const BoxProgram& program, const Vector8& x,
                         const std::array<int, kMaxUnknowns>& held) {
  PlaneForces found;
  for (int k = 0; k < program.size; ++k) {
    if (held[k] == 0 || program.limit[k] == 0 || program.plane[k] == 0) continue;
    double own = program.slope[k];
    for (int j = 0; j < program.size; ++j) own -= program.curvature(k, j) * x[j];
    const double balance = own / program.plane[k];
    if (held[k] * program.plane[k] > 0) {
      if (balance < found.to) found.to = balance, found.at_most = k;
    } else if (balance > found.from) {
      found.from = balance, found.at_least = k;
    }
  }
  return found;
}

// At the minimum of a face: the held unknown whose bound has the most negative Lagrange multiplier,
// so that letting go of it lowers the objective; or -1, and x is optimal.
// `held` is 0, -1 or 1. A limit of 0 is never let go of: that coil is dead.
int pulled_inwards(const BoxProgram& program, const Vector8& x,
                   const std::array<int, kMaxUnknowns>& held, double plane_force) {
  const int n = program.size;
  int worst = -1;
  double pull = 1e-9 * program.slope.head(n).cwiseAbs().maxCoeff();  // less is rounding
  for (int k = 0; k < n; ++k) {
    if (held[k] == 0 || program.limit[k] == 0) continue;
    double own = program.slope[k] - program.plane[k] * plane_force;
    for (int j = 0; j < n; ++j) own -= program.curvature(k, j) * x[j];
    if (-held[k] * own > pull) pull = -held[k] * own, worst = k;
  }
  return worst;
}

}  // namespace

// The primal active-set method for convex quadratic programs (Nocedal & Wright 2006, algorithm
// 16.3) with the bounds as the working set: every iterate is feasible, and the objective never
// rises.
// The start must be feasible, as the method never looks for a feasible point. Ended early by
// `most`, the result is feasible too, only not the best.
int improve(const BoxProgram& program, Vector8& x, int most) {
  const int n = program.size;
  std::array<int, kMaxUnknowns> held{};  // -1 or 1 at a limit
  for (int k = 0; k < n; ++k)
    held[k] = x[k] >= program.limit[k] ? 1 : x[k] <= -program.limit[k] ? -1 : 0;
  int done = 0;
  while (done < most) {
    ++done;
    std::array<int, kMaxUnknowns> free{};
    int count = 0;
    for (int k = 0; k < n; ++k) {
      if (held[k] == 0) free[count++] = k;
    }
    Vector8 downhill = program.slope;
    for (int k = 0; k < n; ++k) downhill.head(n) -= x[k] * program.curvature.col(k).head(n);
    const FreeStep step(program, free, count, downhill);
    if (meets_bound(program, free, count, step, x, held)) continue;
    // The full step was taken: the minimum of this face. Let go of one bound, or be done.
    // Where no free unknown moves the level (a corner), one that does cannot move alone: the two
    // that contradict each other about the plane's multiplier go, both inwards and downhill.
    const PlaneForces forces = step.moves_level() ? PlaneForces{} : plane_forces(program, x, held);
    const double force = step.moves_level() ? step.plane_force() : forces.middle();
    const int worst = pulled_inwards(program, x, held, force);
    if (worst < 0) break;
    if (program.plane[worst] != 0 && forces.at_least >= 0 && forces.at_most >= 0) {
      held[forces.at_least] = held[forces.at_most] = 0;
    } else {
      held[worst] = 0;
    }
  }
  return done;
}

}  // namespace vitreo::control
