// SPDX-License-Identifier: Apache-2.0
#include "control/allocation.h"

#include "control/robot.h"

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

const double kNan = std::numeric_limits<double>::quiet_NaN();
const double kWeight = coni_2mm().net_weight(Medium{});

Eigen::Vector3d random_vector(std::mt19937_64& random, double size) {
  std::normal_distribution<double> normal(0, size);
  const double x = normal(random), y = normal(random), z = normal(random);
  return {x, y, z};
}

FieldAndForce hold(const Eigen::Vector3d& field) { return {field, {0, 0, kWeight}, {0, 0, 0}}; }

Eigen::Vector3d moment_in(const Eigen::Vector3d& field) {
  return coni_2mm().moment(field.norm()) * field.normalized();
}

struct Made {
  Eigen::Vector3d field, force;
};

Made made(const FieldMatrix& matrix, const Eigen::Vector3d& moment, const Currents& currents) {
  const FieldGradient f = matrix * currents;
  return {f.head<3>(), force_from_field(moment) * f};
}

std::string complaint(const std::function<void()>& call) {
  try {
    call();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

TEST(Allocate, holds_the_robot_at_the_center_with_the_published_currents) {
  const FieldMatrix matrix = CoilField::octomag().matrix({0, 0, 0});
  const auto largest = [&](const Eigen::Vector3d& field) {
    return allocate(matrix, moment_in(field), hold(field), 12).currents.cwiseAbs().maxCoeff();
  };
  // Facts 2: 2.96 and 4.49 A; half a digit, and the two-digit moment is 0.7 %.
  EXPECT_NEAR(largest({20e-3, 0, 0}), 2.96, 0.02);
  EXPECT_NEAR(largest({0, 0, 20e-3}), 4.49, 0.03);
}

TEST(Allocate, makes_exactly_the_wanted_field_and_force_with_the_least_current) {
  const CoilField octomag = CoilField::octomag();
  std::mt19937_64 random(1);
  for (int trial = 0; trial < 200; ++trial) {
    const FieldMatrix matrix = octomag.matrix(random_vector(random, 3e-3));
    const Eigen::Vector3d field = 10e-3 * random_vector(random, 1).normalized(),
                          moment = moment_in(field);
    const FieldAndForce wanted{field, {0, 0, kWeight}, random_vector(random, 2e-6)};
    const Allocation result = allocate(matrix, moment, wanted, 1e3);
    EXPECT_FALSE(result.limited());
    const Made got = made(matrix, moment, result.currents);
    // The condition of the solve is below 200: 1e-13 would do, 1e-11 leaves room.
    EXPECT_LT((got.field - field).norm(), 1e-11 * field.norm());
    EXPECT_LT((got.force - wanted.levitation - wanted.force).norm(), 1e-11 * kWeight);
    Eigen::Matrix<double, 6, 8> a;
    a << matrix.topRows<3>(), force_from_field(moment) * matrix;
    const Eigen::MatrixXd null = Eigen::FullPivLU<Eigen::Matrix<double, 6, 8>>(a).kernel();
    // Least norm: nothing of the currents lies where they would do nothing.
    EXPECT_LT((null.transpose() * result.currents).norm(),
              1e-9 * null.norm() * result.currents.norm());
  }
}

TEST(Allocate, cuts_first_the_force_then_the_field_and_never_the_levitation) {
  const CoilField octomag = CoilField::octomag();
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> limits(0.5, 6);
  int force_cut = 0, field_cut = 0, refused = 0;
  for (int trial = 0; trial < 500; ++trial) {
    const FieldMatrix matrix = octomag.matrix(random_vector(random, 3e-3));
    const Eigen::Vector3d field = 20e-3 * random_vector(random, 1).normalized(),
                          moment = moment_in(field);
    const FieldAndForce wanted{field, {0, 0, kWeight}, random_vector(random, 30e-6)};
    const double limit = limits(random);
    Allocation result;
    try {
      result = allocate(matrix, moment, wanted, limit);
    } catch (const std::domain_error&) {
      ++refused;
      EXPECT_GT(allocate(matrix, moment, {{0, 0, 0}, wanted.levitation, {0, 0, 0}}, 1e3)
                    .currents.cwiseAbs()
                    .maxCoeff(),
                limit);
      continue;
    }
    EXPECT_LE(result.currents.cwiseAbs().maxCoeff(), limit);
    const Made got = made(matrix, moment, result.currents);
    EXPECT_LT((got.field - result.field_scale * field).norm(), 1e-11 * field.norm());  // as above
    EXPECT_LT((got.force - wanted.levitation - result.force_scale * wanted.force).norm(),
              1e-9 * kWeight);
    EXPECT_TRUE(result.field_scale == 1 || result.force_scale == 0);
    if (result.limited()) {
      EXPECT_NEAR(result.currents.cwiseAbs().maxCoeff(), limit, 1e-9);  // no less than it could
    }
    force_cut += result.field_scale == 1 && result.force_scale < 1;
    field_cut += result.field_scale < 1;
  }
  EXPECT_GT(force_cut, 50);  // the draw has plenty of every case
  EXPECT_GT(field_cut, 50);
  EXPECT_GT(refused, 5);
}

TEST(Allocate, refuses_when_the_levitation_alone_is_too_much) {
  const FieldMatrix matrix = CoilField::octomag().matrix({0, 0, 0});
  const Eigen::Vector3d field(20e-3, 0, 0);
  EXPECT_THROW(allocate(matrix, moment_in(field), hold(field), 0.1), std::domain_error);
}

TEST(Allocate, works_with_two_dead_coils_and_refuses_with_three) {
  FieldMatrix matrix = CoilField::octomag().matrix({1e-3, 2e-3, 0});
  const Eigen::Vector3d field(8e-3, 5e-3, 3e-3), moment = moment_in(field);
  matrix.col(1).setZero();
  matrix.col(4).setZero();
  const Allocation result = allocate(matrix, moment, hold(field), 100);
  EXPECT_EQ(result.currents[1], 0);
  EXPECT_EQ(result.currents[4], 0);
  EXPECT_LT((made(matrix, moment, result.currents).field - field).norm(), 1e-10 * field.norm());
  matrix.col(6).setZero();
  EXPECT_THROW(allocate(matrix, moment, hold(field), 100), std::domain_error);
}

TEST(Allocate, refuses_coils_that_cannot_make_force_and_field) {
  const Eigen::Vector3d field(10e-3, 0, 0), moment = moment_in(field);
  const FieldMatrix octomag = CoilField::octomag().matrix({0, 0, 0});
  EXPECT_THROW(allocate(FieldMatrix::Zero(8, 8), moment, hold(field), 12), std::domain_error);
  EXPECT_THROW(allocate(octomag.leftCols<5>(), moment, hold(field), 12), std::domain_error);
  FieldMatrix twins = octomag;
  for (int k = 1; k < 4; ++k) twins.col(2 * k) = twins.col(0);
  EXPECT_THROW(allocate(twins, moment, hold(field), 12), std::domain_error);
  EXPECT_THROW(allocate(octomag, {0, 0, 0}, hold(field), 12), std::domain_error);
}

TEST(Allocate, names_the_argument_that_is_no_number) {
  const FieldMatrix matrix = CoilField::octomag().matrix({0, 0, 0});
  const Eigen::Vector3d field(10e-3, 0, 0), moment = moment_in(field), bad(0, kNan, 0);
  FieldMatrix bad_matrix = matrix;
  bad_matrix(3, 3) = kNan;
  const auto says = [](const std::string& text, const std::string& name) {
    return text.rfind(name + ":", 0) == 0;
  };
  EXPECT_TRUE(says(complaint([&] { allocate(bad_matrix, moment, hold(field), 12); }), "matrix"));
  EXPECT_TRUE(says(complaint([&] { allocate(matrix, bad, hold(field), 12); }), "moment"));
  EXPECT_TRUE(says(complaint([&] {
                     allocate(matrix, moment, {bad, {0, 0, 0}, {0, 0, 0}}, 12);
                   }),
                   "wanted.field"));
  EXPECT_TRUE(says(complaint([&] {
                     allocate(matrix, moment, {field, bad, {0, 0, 0}}, 12);
                   }),
                   "wanted.levitation"));
  EXPECT_TRUE(says(complaint([&] {
                     allocate(matrix, moment, {field, {0, 0, 0}, bad}, 12);
                   }),
                   "wanted.force"));
  for (const double limit : {0.0, -1.0, kNan, std::numeric_limits<double>::infinity()}) {
    EXPECT_TRUE(says(complaint([&] { allocate(matrix, moment, hold(field), limit); }), "limit"));
  }
}

TEST(Allocate, asks_for_nothing_when_nothing_is_wanted) {
  const FieldMatrix matrix = CoilField::octomag().matrix({0, 0, 0});
  const Allocation result = allocate(matrix, {1e-5, 0, 0}, FieldAndForce{}, 12);
  EXPECT_EQ(result.currents.norm(), 0);
  EXPECT_FALSE(result.limited());
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
