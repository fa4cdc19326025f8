// Currents of allocate, by elimination and the coils' nearest limits; improve, by duality bounds.
// SPDX-License-Identifier: Apache-2.0
#include "control/allocation.h"
#include "control/box_program.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

using Eigen::Vector3d;
using Real = long double;
using Six = std::array<Real, 6>;
using Row = std::array<Real, kMaxCoils>;  // one number a coil, 0 beyond the last
using Unknowns = Eigen::Matrix<double, kMaxUnknowns, 1>;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

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

 private:
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
};

/// T/A and T/m/A: B, and the force (m . grad) B over |m| of the whole gradient.
std::array<Row, 6> field_and_force(const FieldMatrix& matrix, const Vector3d& moment) {
  std::array<Row, 6> rows{};
  for (int k = 0; k < matrix.cols(); ++k) {
    const auto g = matrix.col(k);
    const Real whole[3][3] = {{g[3], g[4], g[5]}, {g[4], g[6], g[7]}, {g[5], g[7], -g[3] - g[6]}};
    for (int i = 0; i < 3; ++i) {
      rows[i][k] = g[i];
      for (int j = 0; j < 3; ++j) rows[3 + i][k] += moment[j] / moment.norm() * whole[i][j];
    }
  }
  return rows;
}

/// A' (A A')^-1 w by elimination with pivots.
Row least_norm(const std::array<Row, 6>& rows, Six wanted) {
  Real square[6][6] = {};
  for (int i = 0; i < 6; ++i)
    for (int j = 0; j < 6; ++j)
      for (int k = 0; k < kMaxCoils; ++k) square[i][j] += rows[i][k] * rows[j][k];
  for (int c = 0; c < 6; ++c) {
    int pivot = c;
    for (int r = c; r < 6; ++r)
      if (std::abs(square[r][c]) > std::abs(square[pivot][c])) pivot = r;
    std::swap(square[c], square[pivot]);
    std::swap(wanted[c], wanted[pivot]);
    for (int r = 0; r < 6; ++r) {
      if (r == c) continue;
      const Real factor = square[r][c] / square[c][c];
      for (int k = c; k < 6; ++k) square[r][k] -= factor * square[c][k];
      wanted[r] -= factor * wanted[c];
    }
  }
  Row currents{};
  for (int k = 0; k < kMaxCoils; ++k)
    for (int i = 0; i < 6; ++i) currents[k] += rows[i][k] * wanted[i] / square[i][i];
  return currents;
}

/// The largest s of 0 to 1 with |base + s more| <= limit in all coils; below 0 where there is none.
/// Such s are an interval, which need not begin at 0.
Real largest_share(const Row& base, const Row& more, Real limit) {
  Real low = 0;
  Real high = 1;
  for (int k = 0; k < kMaxCoils; ++k) {
    if (more[k] == 0) continue;
    const Real one = (limit - base[k]) / more[k];
    const Real other = (-limit - base[k]) / more[k];
    low = std::max(low, std::min(one, other));
    high = std::min(high, std::max(one, other));
  }
  return low <= high ? high : -1;
}

struct Parts {
  Row levitation, field, force;
};

/// The currents of each part of what is wanted alone.
Parts parts(const FieldMatrix& matrix, const Vector3d& moment, const FieldAndForce& wanted) {
  const auto rows = field_and_force(matrix, moment);
  Six levitation{};
  Six field{};
  Six force{};
  for (int i = 0; i < 3; ++i) {
    field[i] = wanted.field[i];
    levitation[3 + i] = wanted.levitation[i] / moment.norm();
    force[3 + i] = wanted.force[i] / moment.norm();
  }
  return {least_norm(rows, levitation), least_norm(rows, field), least_norm(rows, force)};
}

TEST(AllocationReference, cuts_the_extra_force_then_the_field_and_never_the_levitation) {
  Draw draw(51);
  int whole = 0;
  int force_cut = 0;
  int field_cut = 0;
  int refused = 0;
  for (int n = 0; n < 400; ++n) {
    const FieldMatrix matrix = draw.matrix(6 + n % 3);
    const Vector3d moment = draw.vector(3e-7);
    const FieldAndForce wanted{draw.vector(8e-3), draw.vector(30e-3 * moment.norm()),
                               draw.vector(0.1 * moment.norm())};
    const double limit = std::pow(10, draw.between(-0.5, 2));
    const auto [levitation, field, force] = parts(matrix, moment, wanted);
    Row both{};
    for (int k = 0; k < kMaxCoils; ++k) both[k] = levitation[k] + field[k];
    Real field_scale = 1;
    Real force_scale = largest_share(both, force, limit);
    if (force_scale < 0) {
      force_scale = 0;
      field_scale = largest_share(levitation, field, limit);
    }
    SCOPED_TRACE(n);
    if (field_scale < 0) {
      EXPECT_THROW(allocate(matrix, moment, wanted, limit), std::domain_error);
      ++refused;
      continue;
    }
    const Allocation got = allocate(matrix, moment, wanted, limit);
    ++(field_scale < 1 ? field_cut : force_scale < 1 ? force_cut : whole);
    EXPECT_NEAR(got.force_scale, static_cast<double>(force_scale), 1e-9);
    EXPECT_NEAR(got.field_scale, static_cast<double>(field_scale), 1e-9);
    EXPECT_EQ(got.limited(), force_scale < 1);
    ASSERT_EQ(got.currents.size(), matrix.cols());
    for (int k = 0; k < matrix.cols(); ++k) {
      const Real expected = levitation[k] + field_scale * field[k] + force_scale * force[k];
      EXPECT_NEAR(got.currents[k], static_cast<double>(expected),
                  1e-8 * got.currents.cwiseAbs().maxCoeff());
      EXPECT_LE(std::abs(got.currents[k]), limit * (1 + 1e-12));
    }
  }
  EXPECT_GT(std::min({whole, force_cut, field_cut, refused}), 10);
}

std::string refusal(const FieldMatrix& matrix, const Vector3d& moment, const FieldAndForce& wanted,
                    double limit) {
  try {
    static_cast<void>(allocate(matrix, moment, wanted, limit));
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "none";
}

TEST(AllocationReference, names_the_argument_that_is_not_finite_or_a_limit_not_above_zero) {
  Draw draw(52);
  const FieldMatrix matrix = draw.matrix(8);
  const Vector3d moment = draw.vector(3e-7);
  const FieldAndForce wanted{draw.vector(8e-3), draw.vector(8e-9), draw.vector(5e-9)};
  ASSERT_EQ(refusal(matrix, moment, wanted, 1e3), "none");
  for (const double bad : {kNan, kInfinity, -kInfinity}) {
    for (int i = 0; i < 3; ++i) {
      FieldAndForce wrong = wanted;
      wrong.field[i] = bad;
      EXPECT_EQ(refusal(matrix, moment, wrong, 1e3), "wanted.field: not finite");
      wrong = wanted;
      wrong.levitation[i] = bad;
      EXPECT_EQ(refusal(matrix, moment, wrong, 1e3), "wanted.levitation: not finite");
      wrong = wanted;
      wrong.force[i] = bad;
      EXPECT_EQ(refusal(matrix, moment, wrong, 1e3), "wanted.force: not finite");
      Vector3d wrong_moment = moment;
      wrong_moment[i] = bad;
      EXPECT_EQ(refusal(matrix, wrong_moment, wanted, 1e3), "moment: not finite");
    }
    for (const int i : {0, 7}) {
      FieldMatrix wrong = matrix;
      wrong(i, 7 - i) = bad;
      EXPECT_EQ(refusal(wrong, moment, wanted, 1e3), "matrix: not finite");
    }
  }
  for (const double bad : {kNan, kInfinity, -kInfinity, 0., -2.})
    EXPECT_EQ(refusal(matrix, moment, wanted, bad), "limit: must be finite and above 0 A") << bad;
}

TEST(AllocationReference, refuses_a_short_rank) {
  Draw draw(53);
  const FieldMatrix matrix = draw.matrix(7);
  const Vector3d moment = draw.vector(3e-7);
  const FieldAndForce wanted{draw.vector(8e-3), {}, {}};
  EXPECT_THROW(allocate(matrix, Vector3d::Zero(), wanted, 1e6), std::domain_error);
  EXPECT_THROW(allocate(matrix.leftCols(5), moment, wanted, 1e6), std::domain_error);
  EXPECT_NO_THROW(allocate(matrix.rightCols(6), moment, wanted, 1e6));
  FieldMatrix alike = matrix;
  alike.col(6) = -1.7 * alike.col(1);
  EXPECT_NO_THROW(allocate(alike, moment, wanted, 1e6));
  EXPECT_THROW(allocate(alike.rightCols(6), moment, wanted, 1e6), std::domain_error);
  alike.col(0).setZero();
  EXPECT_THROW(allocate(alike, moment, wanted, 1e6), std::domain_error);
}

/// Random, of `size` unknowns; what lies beyond them is NaN and must not matter.
BoxProgram program(Draw& draw, int size) {
  BoxProgram p;
  p.size = size;
  p.curvature.setConstant(kNan);
  p.slope.setConstant(kNan);
  p.plane.setConstant(kNan);
  p.limit.setConstant(kNan);
  Eigen::Matrix<double, kMaxUnknowns, kMaxUnknowns> root;
  for (int i = 0; i < kMaxUnknowns; ++i)
    for (int j = 0; j < kMaxUnknowns; ++j) root(i, j) = draw.normal();
  for (int i = 0; i < size; ++i) {
    p.slope[i] = 9 * draw.normal();
    p.plane[i] = draw.normal();
    p.limit[i] = draw.between(0.3, 2);
    for (int j = 0; j < size; ++j)
      p.curvature(i, j) = root.row(i).dot(root.row(j)) + (i == j ? 0.3 : 0);
  }
  return p;
}

Unknowns start(Draw& draw, const BoxProgram& p, double share) {
  Unknowns x = Unknowns::Constant(kNan);
  for (int i = 0; i < p.size; ++i) x[i] = std::clamp(share * draw.normal(), -1., 1.) * p.limit[i];
  return x;
}

Real value(const BoxProgram& p, const Unknowns& x) {
  Real sum = 0;
  for (int i = 0; i < p.size; ++i) {
    sum -= static_cast<Real>(p.slope[i]) * x[i];
    for (int j = 0; j < p.size; ++j) sum += static_cast<Real>(p.curvature(i, j)) * x[i] * x[j] / 2;
  }
  return sum;
}

Real level(const BoxProgram& p, const Unknowns& x) {
  Real sum = 0;
  for (int i = 0; i < p.size; ++i) sum += static_cast<Real>(p.plane[i]) * x[i];
  return sum;
}

/// By how much anything in the box and on the plane can be lower, at most: g the gradient, the sum
/// of d_i x_i + |d_i| limit_i with d = g - push a, for the best multiplier of the plane.
Real gap(const BoxProgram& p, const Unknowns& x) {
  Real least = std::numeric_limits<Real>::infinity();
  std::array<Real, kMaxUnknowns> gradient{};
  for (int i = 0; i < p.size; ++i) {
    gradient[i] = -p.slope[i];
    for (int j = 0; j < p.size; ++j) gradient[i] += static_cast<Real>(p.curvature(i, j)) * x[j];
  }
  for (int j = 0; j < p.size; ++j) {
    Real sum = 0;
    for (int i = 0; i < p.size; ++i) {
      const Real d = gradient[i] - gradient[j] / p.plane[j] * p.plane[i];
      sum += d * x[i] + std::abs(d) * p.limit[i];
    }
    least = std::min(least, sum);
  }
  return least;
}

TEST(BoxProgramReference, ends_at_the_optimum_of_the_box_and_the_starts_own_plane) {
  Draw draw(54);
  for (int n = 0; n < 600; ++n) {
    BoxProgram p = program(draw, 1 + n % kMaxUnknowns);
    if (n % 3 == 0) p.limit[n / 3 % p.size] = 0;
    const Unknowns before = start(draw, p, 0.3);
    Unknowns x = before;
    const int iterations = improve(p, x, 48);
    SCOPED_TRACE(n);
    EXPECT_LT(iterations, 48);
    EXPECT_LT(gap(p, x), 1e-11);
    EXPECT_LE(value(p, x), value(p, before) + 1e-14);
    EXPECT_NEAR(static_cast<double>(level(p, x)), static_cast<double>(level(p, before)), 1e-13);
    for (int i = 0; i < kMaxUnknowns; ++i) {
      if (i < p.size) {
        EXPECT_LE(std::abs(x[i]), p.limit[i]) << i;
      } else {
        EXPECT_TRUE(std::isnan(x[i])) << i;
      }
    }
  }
}

// From a corner, with no unknown between its limits, one released unknown alone cannot move on the
// plane: two have to be let go of.
TEST(BoxProgramReference, ends_at_the_optimum_from_a_corner_too) {
  Draw draw(56);
  for (int n = 0; n < 600; ++n) {
    const BoxProgram p = program(draw, 2 + n % 7);
    Unknowns x = start(draw, p, 1e9);
    EXPECT_LT(improve(p, x, 48), 48) << n;
    EXPECT_LT(gap(p, x), 1e-11) << n;
  }
}

TEST(BoxProgramReference, each_iteration_stays_in_the_box_and_on_the_plane_and_is_no_worse) {
  Draw draw(55);
  for (int n = 0; n < 60; ++n) {
    const BoxProgram p = program(draw, 8);
    const Unknowns before = start(draw, p, n % 2 == 0 ? 0.3 : 4);
    Unknowns none = before;
    EXPECT_EQ(improve(p, none, 0), 0);
    EXPECT_EQ(none, before);
    Unknowns end = before;
    const int needed = improve(p, end, 48);
    Unknowns last = before;
    for (int most = 1; most <= needed + 1; ++most) {
      Unknowns x = before;
      EXPECT_EQ(improve(p, x, most), std::min(most, needed));
      EXPECT_LE(value(p, x), value(p, last) + 1e-13);
      EXPECT_NEAR(static_cast<double>(level(p, x)), static_cast<double>(level(p, before)), 1e-13);
      EXPECT_LE((x.cwiseAbs() - p.limit).maxCoeff(), 0);
      last = x;
    }
    EXPECT_EQ(last, end);
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
