// Currents within limits: the optimum proved by bounds of duality, and the vertical force.
// SPDX-License-Identifier: Apache-2.0
#include "control/box_allocation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
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

Real times(const Row& row, const Currents& currents) {
  Real sum = 0;
  for (int k = 0; k < currents.size(); ++k) sum += row[k] * currents[k];
  return sum;
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

/// By how much anything in the box and on the plane through `x` can be lower than `x`, at most:
/// for a convex function with gradient g, and for each level `push` of the plane's multiplier, the
/// sum over k of d_k x_k + |d_k| limit_k with d = g - push a. One that is 0 proves the optimum.
Real gap(const Row& gradient, const Row& plane, const Currents& x, const CurrentLimits& limits) {
  Real least = std::numeric_limits<Real>::infinity();
  for (int j = 0; j < x.size(); ++j) {
    if (plane[j] == 0) continue;
    Real sum = 0;
    for (int k = 0; k < x.size(); ++k) {
      const Real d = gradient[k] - gradient[j] / plane[j] * plane[k];
      sum += d * x[k] + std::abs(d) * limits[k];
    }
    least = std::min(least, sum);
  }
  return least;
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

/// Sizes, limits, headroom, and field and force of the currents.
void expect_kept(const Problem& p, const BoxAllocation& got) {
  const auto rows = field_and_force(p.matrix, p.moment);
  ASSERT_EQ(got.currents.size(), p.limits.size());
  double largest = 0;
  for (int k = 0; k < p.limits.size(); ++k) {
    EXPECT_LE(std::abs(got.currents[k]), p.limits[k]) << k;
    if (p.limits[k] > 0) largest = std::max(largest, std::abs(got.currents[k]) / p.limits[k]);
  }
  EXPECT_NEAR(got.headroom, 1 - largest, 1e-15);
  const double rounding = 1e-14 * got.currents.norm();
  for (int i = 0; i < 3; ++i) {
    const auto field = static_cast<double>(times(rows[i], got.currents));
    const auto force = static_cast<double>(times(rows[3 + i], got.currents));
    EXPECT_NEAR(got.field[i], field, rounding * 2.3e-3);
    EXPECT_NEAR(got.force[i], force, rounding * 70e-3 * p.moment.norm());
  }
}

/// Within the limits, the vertical force as it must be, and no better currents than these.
void expect_best(const Problem& p, const Misses& misses, const BoxAllocation& got) {
  expect_kept(p, got);
  const Row vertical = field_and_force(p.matrix, p.moment)[5];
  const double reach = p.reach();
  const double asked = p.wanted.levitation.z() + p.wanted.force.z();
  const double most = std::max(0.7 * reach, std::abs(p.wanted.levitation.z()));
  EXPECT_EQ(got.vertical_cut, std::abs(asked) > most);
  EXPECT_NEAR(got.force.z(), std::clamp(asked, -most, most), 1e-13 * reach);
  Row gradient{};
  Real square = 0;
  for (std::size_t i = 0; i < misses.rows.size(); ++i) {
    const Real miss = times(misses.rows[i], got.currents) - misses.wanted[i];
    for (int k = 0; k < kMaxCoils; ++k) {
      gradient[k] += 2 * misses.rows[i][k] * miss;
      square += misses.rows[i][k] * misses.rows[i][k];
    }
  }
  // eps |I|^2 may cost so much: eps is a billionth of the rows' square.
  EXPECT_LT(gap(gradient, vertical, got.currents, p.limits),
            4e-9L * square * p.limits.squaredNorm());
  EXPECT_LE(got.iterations, 48);
}

TEST(BoxAllocationReference, is_the_optimum_within_the_limits) {
  Draw draw(12);
  for (int n = 0; n < 400; ++n) {
    const int coils = 4 + n % 5;
    const unsigned dead = (n % 3 == 1 ? 1U : 0U) + (n % 4 == 1 ? 1U << (coils - 1) : 0U);
    Problem p = problem(draw, coils, n % 7 == 0 ? 1 : 4, dead);
    if (n % 11 == 0) p.weights = {};
    SCOPED_TRACE(n);
    const BoxAllocation got = p.field();
    expect_best(p, of_field(p.matrix, p.moment, p.wanted, p.weights), got);
    if (got.headroom < 1e-12) {
      EXPECT_GT(got.iterations, 0);
    }
  }
}

TEST(BoxAllocationReference, five_degrees_are_the_optimum_within_the_limits) {
  Draw draw(13);
  for (int n = 0; n < 400; ++n) {
    const int coils = 4 + n % 5;
    const unsigned dead = (n % 3 == 1 ? 1U : 0U) + (n % 4 == 1 ? 1U << (coils - 1) : 0U);
    const Problem p = problem(draw, coils, n % 7 == 0 ? 1 : 4, dead);
    SCOPED_TRACE(n);
    expect_best(p, of_torque(p.matrix, p.moment, p.torque, p.wanted, p.weights), p.five());
  }
}

/// A problem of eight coils of which the first is dead, `share` of the vertical reach as levitation
/// and `more` as force on top.
Problem lifted(double share, double more) {
  Draw draw(21);
  Problem p = problem(draw, 8, 0.5, 1);
  p.wanted.levitation.z() = share * p.reach();
  p.wanted.force.z() = more * p.reach();
  return p;
}

TEST(BoxAllocationReference, cuts_the_vertical_force_to_70_percent_of_the_reach_or_the_levitation) {
  struct Case {
    double levitation, force, made;
    bool cut;
  };
  for (const auto& [levitation, force, made, cut] :
       std::vector<Case>{{0.1, 0.5999, 0.6999, false},
                         {0.1, 0.6001, 0.7, true},
                         {0.1, 40, 0.7, true},
                         {-0.2, 3, 0.7, true},
                         {0.1, -0.7999, -0.6999, false},
                         {0.1, -0.8001, -0.7, true},
                         {-0.3, -40, -0.7, true},
                         {0.8, 0, 0.8, false},
                         {0.8, 0.01, 0.8, true},
                         {-0.8, -0.01, -0.8, true},
                         {0.8, -0.4, 0.4, false},
                         {0.999, 0, 0.999, false},
                         {-0.999, 0, -0.999, false}}) {
    SCOPED_TRACE(testing::Message() << levitation << ' ' << force);
    const Problem p = lifted(levitation, force);
    for (const bool five : {false, true}) {
      const BoxAllocation got = five ? p.five() : p.field();
      expect_kept(p, got);
      EXPECT_NEAR(got.force.z() / p.reach(), made, 1e-12);
      EXPECT_EQ(got.vertical_cut, cut);
      EXPECT_TRUE(got.limited || !cut);
    }
  }
}

TEST(BoxAllocationReference, refuses_a_levitation_out_of_reach_whatever_the_rest) {
  for (const double sign : {-1., 1.}) {
    for (const double force : {0., 1e-6, 0.9}) {
      const Problem p = lifted(sign * 1.0001, sign * force);
      EXPECT_THROW(p.field(), std::domain_error) << sign << ' ' << force;
      EXPECT_THROW(p.five(), std::domain_error) << sign << ' ' << force;
    }
  }
  // Each coil counts with its own limit: without the last one, held before, it is out of reach.
  Problem p = lifted(0.97, 0);
  EXPECT_NO_THROW(p.field());
  p.limits[7] = 0;
  EXPECT_THROW(p.field(), std::domain_error);
  EXPECT_THROW(p.five(), std::domain_error);
}

TEST(BoxAllocationReference, a_force_against_it_may_bring_such_a_levitation_back) {
  EXPECT_NO_THROW(lifted(1.0001, -0.9).field());
  EXPECT_NO_THROW(lifted(-1.0001, 0.9).five());
}

TEST(BoxAllocationReference, takes_one_and_three_as_weights_by_itself) {
  Draw draw(22);
  Problem p = problem(draw, 8, 4);
  p.weights = {1, 3};
  const BoxAllocation given = p.field();
  ASSERT_TRUE(given.limited);
  EXPECT_EQ(allocate_within(p.matrix, p.moment, p.wanted, p.limits).currents, given.currents);
  EXPECT_EQ(allocate_five_degrees(p.matrix, p.moment, p.torque, p.wanted, p.limits).currents,
            p.five().currents);
}

TEST(BoxAllocationReference, at_rest_nothing_is_limited) {
  Draw draw(23);
  Problem p = problem(draw, 7, 1, 1);
  p.wanted = {};
  const BoxAllocation got = p.field();
  EXPECT_EQ(got.currents.norm(), 0);
  EXPECT_EQ(got.headroom, 1);
  EXPECT_EQ(got.iterations, 0);
  EXPECT_FALSE(got.limited || got.vertical_cut);
}

// Of three coils far within their limits.
TEST(BoxAllocationReference, a_short_rank_alone_costs_something_too) {
  Draw draw(27);
  Problem p = problem(draw, 3, 1);
  p.limits *= 1e3;
  const BoxAllocation got = p.field();
  ASSERT_GT(got.headroom, 0.5);
  EXPECT_TRUE(got.limited);
  EXPECT_GT(got.iterations, 0);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
