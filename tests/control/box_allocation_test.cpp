// The box programme: optimal, within limits, levitation first, whatever is dead or out of reach.
// SPDX-License-Identifier: Apache-2.0
#include "control/box_allocation.h"

#include "control/box_program.h"
#include "control/robot.h"
#include "tests/control/field_support.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <stdexcept>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

using Vector8 = Eigen::Matrix<double, 8, 1>;
const double kWeight = coni_2mm().net_weight(Medium{});

struct Draw {
  FieldMatrix matrix;
  Eigen::Vector3d moment;
  FieldAndForce wanted;
};

Draw drawn(std::mt19937_64& random, double field, double force) {
  static const CoilField octomag = CoilField::octomag();
  Draw draw;
  draw.matrix = octomag.matrix(place_within(random, 8e-3));
  const Eigen::Vector3d axis = any_direction(random);
  draw.moment = coni_2mm().moment(field) * axis;
  draw.wanted = {field * axis, {0, 0, kWeight}, force * any_direction(random)};
  return draw;
}

CurrentLimits limits_of(double limit) { return CurrentLimits::Constant(8, limit); }

TEST(AllocateWithin, coils_of_less_than_an_ampere_have_a_headroom_too) {
  std::mt19937_64 random(2);
  for (int trial = 0; trial < 20; ++trial) {
    Draw draw = drawn(random, 0.1e-3, 0);
    draw.wanted.levitation.setZero();
    const BoxAllocation given =
        allocate_within(draw.matrix, draw.moment, draw.wanted, limits_of(0.5));
    const double largest = given.currents.cwiseAbs().maxCoeff();
    ASSERT_GT(largest, 1e-3);
    EXPECT_NEAR(given.headroom, 1 - largest / 0.5, 1e-12);
  }
}

TEST(AllocateWithin, is_the_least_norm_answer_where_no_limit_is_met) {
  std::mt19937_64 random(1);
  for (int trial = 0; trial < 100; ++trial) {
    const Draw draw = drawn(random, 10e-3, 5e-6);
    const BoxAllocation got =
        allocate_within(draw.matrix, draw.moment, draw.wanted, limits_of(1e3));
    const Currents same = allocate(draw.matrix, draw.moment, draw.wanted, 1e3).currents;
    EXPECT_LT((got.currents - same).norm(),
              1e-11 * same.norm());  // two orders of the same sums, condition 200
    EXPECT_FALSE(got.limited);
    EXPECT_EQ(got.iterations, 0);
    EXPECT_NEAR(got.headroom, 1 - same.cwiseAbs().maxCoeff() / 1e3, 1e-12);
    EXPECT_LT((got.field - draw.wanted.field).norm(), 1e-11 * 10e-3);
  }
}

TEST(AllocateWithin, never_reverses_or_drops_the_levitation_at_any_limit) {
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> exponent(-1, 1.2);
  int limited = 0, cut = 0, refused = 0, most = 0;
  for (int trial = 0; trial < 20000; ++trial) {
    const Draw draw = drawn(random, trial % 2 == 0 ? 20e-3 : 5e-3, 60e-6);
    CurrentLimits limits = limits_of(std::pow(10, exponent(random)));
    if (trial % 3 == 0) limits[trial % 8] = 0;  // a dead coil
    BoxAllocation got;
    try {
      got = allocate_within(draw.matrix, draw.moment, draw.wanted, limits);
    } catch (const std::domain_error&) {
      ++refused;
      continue;
    }
    ASSERT_TRUE((got.currents.cwiseAbs().array() <= limits.array()).all());
    const double up = kWeight + draw.wanted.force.z();
    if (up >= 0 && !got.vertical_cut) {
      ASSERT_NEAR(got.force.z(), up, 1e-9 * (std::abs(up) + kWeight));
    }
    if (up >= kWeight) {
      ASSERT_GE(got.force.z(), kWeight * (1 - 1e-9));
    }
    limited += got.limited, cut += got.vertical_cut, most = std::max(most, got.iterations);
  }
  EXPECT_GT(limited, 2000);  // the draw has plenty of every case
  EXPECT_GT(cut, 500);
  EXPECT_GT(refused, 20);
  EXPECT_LT(most, 48);  // the bound was never what ended it
  RecordProperty("most_iterations", most);
  std::printf("  box programme: %d iterations at most\n", most);
}

// The conditions of Karush, Kuhn and Tucker, from the definitions.
TEST(BoxProgram, ends_where_nothing_feasible_is_better) {
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  for (int trial = 0; trial < 2000; ++trial) {
    BoxProgram program;
    program.size = 8;
    Eigen::Matrix<double, 6, 8> a;
    for (double& value : a.reshaped()) value = normal(random);
    program.curvature = a.transpose() * a + 1e-6 * Eigen::Matrix<double, 8, 8>::Identity();
    for (double& value : program.slope) value = 3 * normal(random);
    for (double& value : program.plane) value = normal(random);
    program.limit.setConstant(0.5);
    const double level = 0.5 * 0.4 * program.plane.cwiseAbs().sum();
    Vector8 x = 0.5 * 0.4 * program.plane.cwiseSign();
    EXPECT_LT(improve(program, x, 100), 60);
    ASSERT_LE(x.cwiseAbs().maxCoeff(), 0.5);
    ASSERT_NEAR(program.plane.dot(x), level, 1e-9);  // rounding through a matrix of condition 1e7
    const Vector8 downhill = program.slope - program.curvature * x;
    // On the free unknowns, downhill is along the plane's normal; at the held ones it leads out.
    double mixed = 0, square = 0;
    for (int k = 0; k < 8; ++k) {
      if (std::abs(x[k]) < 0.5)
        mixed += program.plane[k] * downhill[k], square += program.plane[k] * program.plane[k];
    }
    if (square == 0) continue;
    for (int k = 0; k < 8; ++k) {
      const double own = downhill[k] - mixed / square * program.plane[k];
      const double outwards = x[k] >= 0.5 ? own : x[k] <= -0.5 ? -own : -std::abs(own);
      ASSERT_GT(outwards, -1e-6)
          << "trial " << trial;  // 1e-9 of the slope is let pass, curvature 1e-6 rounds more
    }
  }
}

TEST(AllocateWithin, lets_seven_coils_take_the_part_of_a_dead_one) {
  std::mt19937_64 random(4);
  for (int dead = 0; dead < 8; ++dead) {
    const Draw draw = drawn(random, 10e-3, 5e-6);
    CurrentLimits limits = limits_of(12);
    limits[dead] = 0;
    const BoxAllocation all = allocate_within(draw.matrix, draw.moment, draw.wanted, limits_of(12));
    const BoxAllocation seven = allocate_within(draw.matrix, draw.moment, draw.wanted, limits);
    EXPECT_EQ(seven.currents[dead], 0);
    EXPECT_FALSE(seven.limited);
    EXPECT_LT((seven.field - draw.wanted.field).norm(),
              1e-4 * 10e-3);  // where a limit is met, kSmallness shows
    EXPECT_LT((seven.force - draw.wanted.levitation - draw.wanted.force).norm(), 1e-4 * kWeight);
    EXPECT_LE(seven.headroom, all.headroom + 0.3);
    EXPECT_GE(condition_number(draw.matrix, draw.moment, limits),
              condition_number(draw.matrix, draw.moment, limits_of(12)));
  }
}

TEST(AllocateWithin, still_levitates_with_so_few_coils_that_the_rest_cannot_be_had) {
  std::mt19937_64 random(5);
  const Draw draw = drawn(random, 10e-3, 0);
  CurrentLimits limits = limits_of(20);
  for (int k = 0; k < 4; ++k) limits[k] = 0;
  EXPECT_EQ(condition_number(draw.matrix, draw.moment, limits),
            std::numeric_limits<double>::infinity());
  const BoxAllocation got = allocate_within(draw.matrix, draw.moment, draw.wanted, limits);
  EXPECT_NEAR(got.force.z(), kWeight, 1e-9 * kWeight);
  EXPECT_TRUE(got.limited);
}

TEST(AllocateFiveDegrees, makes_torque_and_force_with_less_current_than_a_whole_field_needs) {
  std::mt19937_64 random(6);
  double six = 0, five = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const Draw draw = drawn(random, 20e-3, 5e-6);
    const Eigen::Vector3d torque = 1e-7 * any_direction(random);
    const BoxAllocation got =
        allocate_five_degrees(draw.matrix, draw.moment, torque, draw.wanted, limits_of(1e3));
    const Eigen::Vector3d axis = draw.moment.normalized(),
                          across = torque - torque.dot(axis) * axis;
    EXPECT_LT((draw.moment.cross(got.field) - across).norm(),
              1e-10 * torque.norm());  // rounding, condition 200
    EXPECT_LT((got.force - draw.wanted.levitation - draw.wanted.force).norm(), 1e-10 * kWeight);
    five += got.currents.squaredNorm();
    six += allocate_within(draw.matrix, draw.moment, draw.wanted, limits_of(1e3))
               .currents.squaredNorm();
  }
  EXPECT_LT(five, six);
}

TEST(ConditionNumber, is_the_published_one) {
  const FieldMatrix matrix = CoilField::octomag().matrix({0, 0, 0});
  double low = 1e9, high = 0;
  std::mt19937_64 random(7);
  for (int trial = 0; trial < 200; ++trial) {
    const double c = condition_number(matrix, 1e-5 * any_direction(random), limits_of(12));
    low = std::min(low, c), high = std::max(high, c);
  }
  EXPECT_GT(low, 2.8);  // facts 1.4: 2.9 to 12.5 over the whole cube, the extremes at its corners
  EXPECT_LT(high, 12.5);
}

TEST(AllocateWithin, names_what_is_wrong) {
  std::mt19937_64 random(8);
  Draw draw = drawn(random, 10e-3, 0);
  EXPECT_THROW(
      allocate_within(draw.matrix, draw.moment, draw.wanted, CurrentLimits::Constant(7, 1)),
      std::invalid_argument);
  EXPECT_THROW(allocate_within(draw.matrix, draw.moment, draw.wanted, limits_of(-1)),
               std::invalid_argument);
  EXPECT_THROW(allocate_within(draw.matrix, {0, 0, 0}, draw.wanted, limits_of(1)),
               std::domain_error);
  EXPECT_THROW(allocate_within(draw.matrix, draw.moment, draw.wanted, limits_of(1e-3)),
               std::domain_error);
  draw.wanted.force.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(allocate_within(draw.matrix, draw.moment, draw.wanted, limits_of(1)),
               std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
