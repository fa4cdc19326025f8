// The primal active-set method: solve on the free unknowns, walk until a limit, add it; at the end
// of a walk let go of the limit that pulls the wrong way.
// SPDX-License-Identifier: Apache-2.0
#include "control/box_program.h"

#include <array>
#include <cmath>

namespace vitreo::control {
namespace {

using Vector8 = Eigen::Matrix<double, kMaxUnknowns, 1>;

// The step on the free unknowns that ends at the minimum on the plane: H_FF p = g + nu a_F with
// a_F'p = 0.
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
    double mixed = 0, square = 0;
    for (int i = 0; i < count; ++i) {
      mixed += across_[i] * step_[i];
      square += across_[i] * across_[i];
    }
    // Without a free unknown that moves the level there is no plane to keep to.
    plane_force_ = square > 0 ? mixed / square : 0;
    for (int i = 0; i < count; ++i) step_[i] -= plane_force_ * across_[i];
    backward(step_);
  }

  double operator[](int i) const { return step_[i]; }
  double plane_force() const { return plane_force_; }

 private:
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
  void forward(double* v) const {
    for (int i = 0; i < count_; ++i) {
      for (int k = 0; k < i; ++k) v[i] -= factor_[i][k] * v[k];
      v[i] *= inverse_[i];
    }
  }
  void backward(double* v) const {
    for (int i = count_ - 1; i >= 0; --i) {
      for (int k = i + 1; k < count_; ++k) v[i] -= factor_[k][i] * v[k];
      v[i] *= inverse_[i];
    }
  }

  int count_;
  double plane_force_ = 0;
  double factor_[kMaxUnknowns][kMaxUnknowns];
  double inverse_[kMaxUnknowns], step_[kMaxUnknowns], across_[kMaxUnknowns];
};

// At the minimum of a face: the held unknown that would rather go inwards, the one that pulls most
// first; or -1.
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
    double reach = 1;
    int hit = -1;
    for (int i = 0; i < count; ++i) {
      const int k = free[i];
      const double room = (step[i] > 0 ? program.limit[k] : -program.limit[k]) - x[k];
      if (std::abs(step[i]) * reach > std::abs(room)) reach = room / step[i], hit = i;
    }
    for (int i = 0; i < count; ++i) x[free[i]] += reach * step[i];
    if (hit >= 0) {
      held[free[hit]] = step[hit] > 0 ? 1 : -1;
      x[free[hit]] = held[free[hit]] * program.limit[free[hit]];
      continue;
    }
    const int worst = pulled_inwards(program, x, held, step.plane_force());
    if (worst < 0) break;
    held[worst] = 0;
  }
  return done;
}

}  // namespace vitreo::control
