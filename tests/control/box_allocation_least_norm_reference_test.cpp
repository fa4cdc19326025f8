// Currents of least norm, compared with elimination and, at limits, with every choice of coils.
// SPDX-License-Identifier: Apache-2.0
#include "control/box_allocation.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <random>
#include <utility>
#include <vector>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

using Eigen::Vector3d;
using Real = long double;
using Row = std::array<Real, kMaxCoils>;  // one number a coil, 0 beyond the last

class Draw {
 public:
  explicit Draw(unsigned seed) : random_(seed) {}
  double normal() { return normal_(random_); }
  double between(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  Vector3d vector(double scale) {
    const double x = normal();
    const double y = normal();
    return scale * Vector3d(x, y, normal());
  }
  FieldMatrix matrix(int coils) {
    FieldMatrix matrix(8, coils);
    for (int k = 0; k < coils; ++k)
      for (int i = 0; i < 8; ++i) matrix(i, k) = normal() * (i < 3 ? 2.3e-3 : 70e-3);
    return matrix;
  }
  CurrentLimits limits(int coils, double low, double high) {
    CurrentLimits limits(coils);
    for (int k = 0; k < coils; ++k) limits[k] = between(low, high);
    return limits;
  }

 private:
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
};

/// T/A and N/A: B, and F_i = sum over j of m_j dB_i/dx_j of the whole gradient.
std::array<Row, 6> field_and_force(const FieldMatrix& matrix, const Vector3d& moment) {
  std::array<Row, 6> rows{};
  for (int k = 0; k < matrix.cols(); ++k) {
    const auto g = matrix.col(k);
    const Real whole[3][3] = {{g[3], g[4], g[5]}, {g[4], g[6], g[7]}, {g[5], g[7], -g[3] - g[6]}};
    for (int i = 0; i < 3; ++i) {
      rows[i][k] = g[i];
      for (int j = 0; j < 3; ++j) rows[3 + i][k] += moment[j] * whole[i][j];
    }
  }
  return rows;
}

/// The weighted rows of what is wanted but the vertical force, in T.
struct Misses {
  std::vector<Row> rows;
  std::vector<Real> wanted;
  void add(Row row, Real value, Real weight) {
    for (Real& entry : row) entry *= weight;
    rows.push_back(row);
    wanted.push_back(value * weight);
  }
};

void add_lateral(Misses& misses, const std::array<Row, 6>& rows, const Vector3d& moment,
                 const FieldAndForce& wanted, const AllocationWeights& weights) {
  const Real scale = 20e-3L / std::sqrt(static_cast<Real>(moment.squaredNorm()));
  for (int i = 0; i < 2; ++i)
    misses.add(rows[3 + i], static_cast<Real>(wanted.levitation[i]) + wanted.force[i],
               weights.force * scale);
}

Misses of_field(const FieldMatrix& matrix, const Vector3d& moment, const FieldAndForce& wanted,
                const AllocationWeights& weights) {
  const auto rows = field_and_force(matrix, moment);
  Misses misses;
  for (int i = 0; i < 3; ++i) misses.add(rows[i], wanted.field[i], weights.field);
  add_lateral(misses, rows, moment, wanted, weights);
  return misses;
}

/// Rows m x B over |m|: as long as the part of B across m.
Misses of_torque(const FieldMatrix& matrix, const Vector3d& moment, const Vector3d& torque,
                 const FieldAndForce& wanted, const AllocationWeights& weights) {
  const auto rows = field_and_force(matrix, moment);
  Misses misses;
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3;
    const int l = (i + 2) % 3;
    Row row{};
    for (int k = 0; k < kMaxCoils; ++k) row[k] = moment[j] * rows[l][k] - moment[l] * rows[j][k];
    misses.add(row, torque[i], weights.field / moment.norm());
  }
  add_lateral(misses, rows, moment, wanted, weights);
  return misses;
}

/// Solves square equations by elimination with pivots.
std::vector<Real> solve(std::vector<std::vector<Real>> a, std::vector<Real> b) {
  const std::size_t n = b.size();
  for (std::size_t c = 0; c < n; ++c) {
    std::size_t pivot = c;
    for (std::size_t r = c; r < n; ++r)
      if (std::abs(a[r][c]) > std::abs(a[pivot][c])) pivot = r;
    std::swap(a[c], a[pivot]);
    std::swap(b[c], b[pivot]);
    for (std::size_t r = 0; r < n; ++r) {
      if (r == c) continue;
      const Real factor = a[r][c] / a[c][c];
      for (std::size_t k = c; k < n; ++k) a[r][k] -= factor * a[c][k];
      b[r] -= factor * b[c];
    }
  }
  for (std::size_t c = 0; c < n; ++c) b[c] /= a[c][c];
  return b;
}

/// A' (A A')^-1 w over the coils that `fixed` leaves free (NaN there), the others as it says.
Row least_norm(const std::vector<Row>& rows, std::vector<Real> wanted, const Row& fixed) {
  const std::size_t n = rows.size();
  std::vector<std::vector<Real>> square(n, std::vector<Real>(n, 0));
  for (std::size_t i = 0; i < n; ++i)
    for (int k = 0; k < kMaxCoils; ++k) {
      if (!std::isnan(fixed[k])) wanted[i] -= rows[i][k] * fixed[k];
      for (std::size_t j = 0; j < n && std::isnan(fixed[k]); ++j)
        square[i][j] += rows[i][k] * rows[j][k];
    }
  const std::vector<Real> y = solve(square, wanted);
  Row currents = fixed;
  for (int k = 0; k < kMaxCoils; ++k) {
    if (!std::isnan(fixed[k])) continue;
    currents[k] = 0;
    for (std::size_t i = 0; i < n; ++i) currents[k] += rows[i][k] * y[i];
  }
  return currents;
}

Row all_free() {
  Row free{};
  free.fill(std::numeric_limits<Real>::quiet_NaN());
  return free;
}

/// All six rows, the force over moment times 20 mm: comparable, so that elimination is exact.
Misses all_six(const FieldMatrix& matrix, const Vector3d& moment, const FieldAndForce& wanted) {
  Misses six = of_field(matrix, moment, wanted, {1, 1});
  six.add(field_and_force(matrix, moment)[5], wanted.levitation.z() + wanted.force.z(),
          20e-3 / moment.norm());
  return six;
}

struct Problem {
  FieldMatrix matrix;
  Vector3d moment;
  FieldAndForce wanted;
  CurrentLimits limits;
  AllocationWeights weights;
  Vector3d torque;
  BoxAllocation field() const { return allocate_within(matrix, moment, wanted, limits, weights); }
  BoxAllocation five() const {
    return allocate_five_degrees(matrix, moment, torque, wanted, limits, weights);
  }
  double reach() const {  // N, of the vertical force
    Real sum = 0;
    const Row vertical = field_and_force(matrix, moment)[5];
    for (int k = 0; k < limits.size(); ++k) sum += std::abs(vertical[k]) * limits[k];
    return static_cast<double>(sum);
  }
};

/// About `hardness` times what the limits allow, the levitation within them; `dead` says for each
/// bit whether the coil is.
Problem problem(Draw& draw, int coils, double hardness, unsigned dead = 0) {
  Problem p;
  p.matrix = draw.matrix(coils);
  p.moment = draw.vector(3e-7);
  p.limits = draw.limits(coils, 1, 4);
  for (int k = 0; k < coils; ++k)
    if ((dead >> k) % 2 == 1) p.limits[k] = 0;
  p.wanted.field = draw.vector(8e-3 * hardness);
  p.wanted.levitation = draw.vector(p.moment.norm() * 25e-3);
  p.wanted.levitation.z() = p.reach() * draw.between(-0.65, 0.65);
  p.wanted.force = draw.vector(p.moment.norm() * 0.2 * hardness);
  p.weights = {draw.between(0.4, 2.5), draw.between(0.4, 5)};
  p.torque = draw.vector(8e-3 * hardness * p.moment.norm());
  return p;
}

TEST(BoxAllocationLeastNorm, is_the_least_norm_solution_without_a_limit_in_the_way) {
  Draw draw(11);
  for (int n = 0; n < 60; ++n) {
    Problem p = problem(draw, 6 + n % 3, 1);
    p.limits *= 1e4;
    Row dead = all_free();
    for (int k = static_cast<int>(p.limits.size()); k < kMaxCoils; ++k) dead[k] = 0;
    // The first, the last or a middle coil is dead where there is one to spare.
    const int off = n % 3 == 0 ? -1 : std::array{0, n % 3 + 5, 3}[n / 3 % 3];
    if (off >= 0) {
      p.limits[off] = 0;
      dead[off] = 0;
    }
    const Misses six = all_six(p.matrix, p.moment, p.wanted);
    const Row expected = least_norm(six.rows, six.wanted, dead);
    const BoxAllocation got = p.field();
    for (int k = 0; k < p.limits.size(); ++k)
      EXPECT_NEAR(got.currents[k], static_cast<double>(expected[k]),
                  1e-9 * got.currents.cwiseAbs().maxCoeff());
    EXPECT_EQ(got.iterations, 0);
    EXPECT_FALSE(got.limited || got.vertical_cut);
    if (off >= 0) {
      EXPECT_EQ(got.currents[off], 0);
    }
  }
}

/// The least norm of all currents that make the six rows within the limits with two coils or fewer
/// at theirs, tried one by one; nothing where there are none.
std::optional<Row> least_norm_within(const Misses& six, const CurrentLimits& limits) {
  std::optional<Row> best;
  Real least = std::numeric_limits<Real>::infinity();
  for (int choice = 0; choice < 6561; ++choice) {
    Row fixed = all_free();
    int rest = choice;
    int at_limit = 0;
    for (int k = 0; k < kMaxCoils; ++k, rest /= 3) {
      if (rest % 3 == 0) continue;
      fixed[k] = rest % 3 == 1 ? limits[k] : -limits[k];
      ++at_limit;
    }
    if (at_limit > 2) continue;
    const Row tried = least_norm(six.rows, six.wanted, fixed);
    Real square = 0;
    bool within = true;
    for (int k = 0; k < kMaxCoils; ++k) {
      square += tried[k] * tried[k];
      within = within && std::abs(tried[k]) <= limits[k];
    }
    if (!within || square >= least) continue;
    least = square;
    best = tried;
  }
  return best;
}

TEST(BoxAllocationLeastNorm, is_of_least_norm_where_a_limit_costs_nothing) {
  Draw draw(14);
  int met = 0;
  for (int n = 0; n < 40; ++n) {
    Problem p = problem(draw, 8, 1);
    p.wanted.levitation.z() *= 0.1;
    p.limits *= 1.5;
    const std::optional<Row> expected =
        least_norm_within(all_six(p.matrix, p.moment, p.wanted), p.limits);
    const BoxAllocation got = p.field();
    if (!expected || got.iterations == 0) continue;
    ++met;
    EXPECT_FALSE(got.limited) << n;
    EXPECT_NEAR(got.headroom, 0, 1e-12);
    for (int k = 0; k < 8; ++k) {
      EXPECT_NEAR(got.currents[k], static_cast<double>((*expected)[k]), 1e-4) << n;
    }
    for (int i = 0; i < 3; ++i) {
      EXPECT_NEAR(got.field[i], p.wanted.field[i], 1e-8);
      EXPECT_NEAR(got.force[i] / p.moment.norm(),
                  (p.wanted.force[i] + p.wanted.levitation[i]) / p.moment.norm(), 1e-6);
    }
  }
  EXPECT_GT(met, 5);
}

TEST(BoxAllocationLeastNorm, five_degrees_make_torque_across_and_force_with_least_norm) {
  Draw draw(15);
  for (int n = 0; n < 30; ++n) {
    Problem p = problem(draw, 5 + n % 4, 1);
    p.limits *= 1e4;
    // Two directions across the moment, of other lengths than 1: rows m x B as in T = m x B.
    const auto rows = field_and_force(p.matrix, p.moment);
    Misses five = of_torque(p.matrix, p.moment, p.torque, p.wanted, {1, 1});
    const Vector3d across = p.torque - p.moment * p.moment.dot(p.torque) / p.moment.squaredNorm();
    for (int i = 0; i < 3; ++i) five.wanted[i] = across[i] / p.moment.norm();
    // The three rows m x B have rank two: the one of the moment's longest part goes.
    int longest = 0;
    p.moment.cwiseAbs().maxCoeff(&longest);
    five.rows.erase(five.rows.begin() + longest);
    five.wanted.erase(five.wanted.begin() + longest);
    five.add(rows[5], p.wanted.levitation.z() + p.wanted.force.z(), 20e-3 / p.moment.norm());
    Row none = all_free();
    for (int k = static_cast<int>(p.limits.size()); k < kMaxCoils; ++k) none[k] = 0;
    const Row expected = least_norm(five.rows, five.wanted, none);
    const BoxAllocation got = p.five();
    for (int k = 0; k < p.limits.size(); ++k)
      EXPECT_NEAR(got.currents[k], static_cast<double>(expected[k]),
                  1e-9 * got.currents.cwiseAbs().maxCoeff());
    EXPECT_LT((p.moment.cross(got.field) - across).norm(), 1e-11 * across.norm());
    EXPECT_FALSE(got.limited || got.vertical_cut);
    // Neither the torque along the moment nor the field that is wanted counts.
    Problem other = p;
    other.torque += 0.7 * p.moment.norm() * 5e-3 * p.moment.normalized();
    other.wanted.field = {-0.3, 0.2, 0.5};
    EXPECT_LT((other.five().currents - got.currents).norm(), 1e-10 * got.currents.norm());
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
