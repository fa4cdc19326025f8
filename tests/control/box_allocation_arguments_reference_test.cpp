// Arguments that the box allocation refuses, and the condition compared with Jacobi turns.
// SPDX-License-Identifier: Apache-2.0
#include "control/box_allocation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

using Eigen::Vector3d;
using Real = long double;
using Row = std::array<Real, kMaxCoils>;  // one number a coil, 0 beyond the last
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
};

/// So much is wanted that limits are in the way.
Problem problem(Draw& draw) {
  Problem p;
  p.matrix = draw.matrix(8);
  p.moment = draw.vector(3e-7);
  p.limits = draw.limits(8, 1, 4);
  p.wanted.field = draw.vector(30e-3);
  p.wanted.levitation = draw.vector(7e-9);
  p.wanted.force = draw.vector(0.2e-6);
  p.weights = {0.8, 2.1};
  p.torque = draw.vector(9e-9);
  return p;
}

/// The message of std::invalid_argument, "none" without one.
std::string refusal(const Problem& p, bool five) {
  try {
    static_cast<void>(five ? p.five() : p.field());
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "none";
}

TEST(BoxAllocationArguments, names_the_argument_that_is_not_finite) {
  Draw draw(24);
  const Problem good = problem(draw);
  for (const bool five : {false, true}) {
    ASSERT_EQ(refusal(good, five), "none");
    for (const double bad : {kNan, kInfinity, -kInfinity}) {
      for (int i = 0; i < 3; ++i) {
        Problem p = good;
        p.moment[i] = bad;
        EXPECT_EQ(refusal(p, five), "moment: not finite");
        p = good;
        p.wanted.field[i] = bad;
        EXPECT_EQ(refusal(p, five), "wanted.field: not finite");
        p = good;
        p.wanted.levitation[i] = bad;
        EXPECT_EQ(refusal(p, five), "wanted.levitation: not finite");
        p = good;
        p.wanted.force[i] = bad;
        EXPECT_EQ(refusal(p, five), "wanted.force: not finite");
        p = good;
        p.torque[i] = bad;
        EXPECT_EQ(refusal(p, five), five ? "torque: not finite" : "none");
      }
      for (const int entry : {0, 3, 7}) {
        for (const int coil : {0, 7}) {
          Problem p = good;
          p.matrix(entry, coil) = bad;
          EXPECT_EQ(refusal(p, five), "matrix: not finite");
        }
      }
    }
  }
}

TEST(BoxAllocationArguments, refuses_limits_and_weights_that_are_none) {
  Draw draw(25);
  const Problem good = problem(draw);
  for (const bool five : {false, true}) {
    for (const double bad : {kNan, kInfinity, -1e-9}) {
      for (int k = 0; k < 8; ++k) {
        Problem p = good;
        p.limits[k] = bad;
        EXPECT_EQ(refusal(p, five), "limits: must be at least 0 A") << bad << ' ' << k;
      }
    }
    for (const int size : {0, 7}) {
      Problem p = good;
      p.limits = good.limits.head(size).eval();
      EXPECT_EQ(refusal(p, five), "limits: one a coil is needed") << size;
    }
    Problem less = good;
    less.matrix = good.matrix.leftCols(7).eval();
    EXPECT_EQ(refusal(less, five), "limits: one a coil is needed");
    for (const double bad : {kNan, 0., -1., -kInfinity}) {
      Problem p = good;
      p.weights.field = bad;
      EXPECT_EQ(refusal(p, five), "weights: must be above 0") << bad;
      p = good;
      p.weights.force = bad;
      EXPECT_EQ(refusal(p, five), "weights: must be above 0") << bad;
    }
    Problem still = good;
    still.moment.setZero();
    EXPECT_THROW(static_cast<void>(refusal(still, five)), std::domain_error);
  }
}

TEST(BoxAllocationArguments, weights_whose_squares_leave_no_digits_are_refused) {
  Draw draw(26);
  Problem p = problem(draw);
  for (const double weight : {kInfinity, 1e200, 1.1e9}) {
    p.weights.force = weight;
    EXPECT_EQ(refusal(p, false), "weights: must be at most 1e9");
    p.weights.force = 1;
    p.weights.field = weight;
    EXPECT_EQ(refusal(p, true), "weights: must be at most 1e9");
    p.weights.field = 1;
  }
  p.weights.field = 1e9;
  EXPECT_EQ(refusal(p, false), "none");
}

// Seen by the pivots alone it was not at some ten of 40000 places and sets of coils: the currents
// were then rounding alone, said to be unlimited, and the vertical force anything.
TEST(BoxAllocationArguments, sees_a_lost_rank_everywhere) {
  const CoilField machine = CoilField::octomag();
  const Vector3d moment{3.1e-7, -2.6e-7, 0.7e-7};
  const FieldAndForce wanted{10e-3 * moment.normalized(), {0, 0, 4.5e-8}, {0, 0, 0}};
  const auto held = [](const BoxAllocation& got) {
    return std::abs(got.force.z() - 4.5e-8) < 1e-15;
  };
  int not_held = 0;
  int five_not_held = 0;
  int not_refused = 0;
  for (int place = 0; place < 729; ++place) {
    const Vector3d at = 2e-3 * Vector3d(place % 9 - 4.1, place / 9 % 9 - 4, place / 81 - 3.9);
    const FieldMatrix matrix = machine.matrix(at);
    for (unsigned works = 0; works < 256; ++works) {
      const int count = std::popcount(works);
      if (count != 4 && count != 5) continue;
      CurrentLimits limits(8);
      for (int k = 0; k < 8; ++k) limits[k] = works >> k & 1U ? 1e3 : 0;
      if (count == 4) {
        five_not_held +=
            !held(allocate_five_degrees(matrix, moment, {1e-10, 2e-10, -1e-9}, wanted, limits));
        continue;
      }
      not_held += !held(allocate_within(matrix, moment, wanted, limits));
      try {
        const FieldMatrix dead = matrix * (limits / 1e3).asDiagonal();
        static_cast<void>(allocate(dead, moment, wanted, 1e3));
        ++not_refused;
      } catch (const std::domain_error&) {
      }
    }
  }
  EXPECT_EQ(not_held, 0);
  EXPECT_EQ(five_not_held, 0);
  EXPECT_EQ(not_refused, 0);
}

// "At least 0": with all of them 0 the levitation is out of reach, not a limit below 0.
TEST(BoxAllocationArguments, all_coils_dead_is_a_levitation_out_of_reach) {
  Draw draw(28);
  Problem p = problem(draw);
  p.limits.setZero();
  EXPECT_THROW(p.field(), std::domain_error);
}

/// Largest over smallest singular value of the six rows: the square root of that of A A', which
/// turns in pairs of rows make diagonal.
double condition_by_turns(const FieldMatrix& matrix, const Vector3d& moment,
                          const CurrentLimits& limits) {
  auto rows = field_and_force(matrix, moment);
  for (int i = 3; i < 6; ++i)
    for (Real& entry : rows[i]) entry *= 20e-3 / moment.norm();
  constexpr std::array<int, 6> kOrder{0, 1, 2, 3, 4, 5};
  Real square[6][6] = {};
  for (const int i : kOrder)
    for (const int j : kOrder)
      for (int k = 0; k < limits.size(); ++k)
        if (limits[k] > 0) square[i][j] += rows[i][k] * rows[j][k];
  for (int sweep = 0; sweep < 10; ++sweep) {
    for (int p = 0; p < 6; ++p) {
      for (int q = p + 1; q < 6; ++q) {
        const Real angle = std::atan2(2 * square[p][q], square[p][p] - square[q][q]) / 2;
        const Real c = std::cos(angle);
        const Real s = std::sin(angle);
        for (const int k : kOrder) {
          const Real a = square[p][k];
          const Real b = square[q][k];
          square[p][k] = c * a + s * b;
          square[q][k] = c * b - s * a;
        }
        for (const int k : kOrder) {
          const Real a = square[k][p];
          const Real b = square[k][q];
          square[k][p] = c * a + s * b;
          square[k][q] = c * b - s * a;
        }
      }
    }
  }
  Real least = square[0][0];
  Real largest = least;
  for (const int i : kOrder) {
    least = std::min(least, square[i][i]);
    largest = std::max(largest, square[i][i]);
  }
  return static_cast<double>(std::sqrt(largest / least));
}

TEST(BoxAllocationArguments, condition_is_that_of_the_six_rows_of_the_working_coils) {
  Draw draw(31);
  for (int n = 0; n < 60; ++n) {
    const int coils = 6 + n % 3;
    const FieldMatrix matrix = draw.matrix(coils);
    const Vector3d moment = draw.vector(n % 2 == 0 ? 3e-7 : 40);
    CurrentLimits limits = draw.limits(coils, 0.01, 4);
    if (coils > 6) limits[n % 4 < 2 ? 0 : coils - 1] = 0;
    if (coils > 7) limits[3] = 0;
    const double expected = condition_by_turns(matrix, moment, limits);
    EXPECT_NEAR(condition_number(matrix, moment, limits) / expected, 1, 1e-9) << n;
    // Neither the moment's length nor the limits' size counts.
    EXPECT_NEAR(condition_number(matrix, 1e3 * moment, 7 * limits) / expected, 1, 1e-9) << n;
  }
}

TEST(BoxAllocationArguments, condition_is_infinite_where_a_degree_of_freedom_is_lost) {
  Draw draw(32);
  const FieldMatrix matrix = draw.matrix(8);
  const Vector3d moment = draw.vector(3e-7);
  CurrentLimits limits = draw.limits(8, 1, 4);
  EXPECT_LT(condition_number(matrix, moment, limits), 1e3);
  // Two coils of seven alike, one the other's opposite: the sixth degree is still there.
  limits[7] = 0;
  FieldMatrix alike = matrix;
  alike.col(6) = -2.5 * alike.col(0);
  EXPECT_LT(condition_number(alike, moment, limits), 1e4);
  limits[2] = 0;
  EXPECT_EQ(condition_number(alike, moment, limits), kInfinity);
  EXPECT_LT(condition_number(matrix, moment, limits), 1e4);
  limits[5] = 0;  // five coils left
  EXPECT_EQ(condition_number(matrix, moment, limits), kInfinity);
  FieldMatrix flat = matrix;
  flat.row(2) = 0.3 * flat.row(0) - flat.row(1);
  EXPECT_EQ(condition_number(flat, moment, CurrentLimits::Ones(8)), kInfinity);
  flat = matrix;
  flat.bottomRows(5).setZero();  // field without a gradient: no force
  EXPECT_EQ(condition_number(flat, moment, CurrentLimits::Ones(8)), kInfinity);
  EXPECT_EQ(condition_number(matrix.leftCols(5), moment, CurrentLimits::Ones(5)), kInfinity);
}

std::string condition_refused(const FieldMatrix& matrix, const Vector3d& moment,
                              const CurrentLimits& limits) {
  try {
    static_cast<void>(condition_number(matrix, moment, limits));
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "none";
}

TEST(BoxAllocationArguments, condition_refuses_what_is_not_finite) {
  Draw draw(33);
  const FieldMatrix matrix = draw.matrix(8);
  const Vector3d moment = draw.vector(3e-7);
  const CurrentLimits limits = draw.limits(8, 1, 4);
  for (const double bad : {kNan, kInfinity, -kInfinity}) {
    for (const int i : {0, 7}) {
      FieldMatrix wrong = matrix;
      wrong(i, 7 - i) = bad;
      EXPECT_EQ(condition_refused(wrong, moment, limits), "matrix: not finite");
      CurrentLimits wrong_limits = limits;
      wrong_limits[i] = bad;
      EXPECT_EQ(condition_refused(matrix, moment, wrong_limits), "limits: must be at least 0 A");
      wrong_limits[i] = -1e-9;
      EXPECT_EQ(condition_refused(matrix, moment, wrong_limits), "limits: must be at least 0 A");
    }
    for (int i = 0; i < 3; ++i) {
      Vector3d wrong = moment;
      wrong[i] = bad;
      EXPECT_EQ(condition_refused(matrix, wrong, limits), "moment: not finite");
    }
  }
  EXPECT_EQ(condition_refused(matrix, moment, limits.head(7)), "limits: one a coil is needed");
  EXPECT_THROW(static_cast<void>(condition_number(matrix, Vector3d::Zero(), limits)),
               std::domain_error);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
