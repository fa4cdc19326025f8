// SPDX-License-Identifier: Apache-2.0
#include "control/coil_field.h"

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <stdexcept>
#include <vector>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

const double kNan = std::numeric_limits<double>::quiet_NaN();

Eigen::Vector3d random_place(std::mt19937_64& random, double half_side) {
  std::uniform_real_distribution<double> place(-half_side, half_side);
  const double x = place(random), y = place(random), z = place(random);
  return {x, y, z};
}

Eigen::Vector3d random_direction(std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  const double x = normal(random), y = normal(random), z = normal(random);
  return Eigen::Vector3d(x, y, z).normalized();
}

// d(field of coil k)/dx_axis by a sixth-order central difference.
Eigen::Vector3d differenced(const CoilField& field, const Eigen::Vector3d& p, int coil, int axis) {
  const double h = 0.5e-3;
  const auto at = [&](int steps) {
    return Eigen::Vector3d(
        field.matrix(p + steps * h * Eigen::Vector3d::Unit(axis)).col(coil).head<3>());
  };
  return ((at(3) - at(-3)) - 9 * (at(2) - at(-2)) + 45 * (at(1) - at(-1))) / (60 * h);
}

// The field once more from the scalar potential k m.r/r^3, so that one slip cannot hide in both.
Eigen::Vector3d from_potential(const Dipole& dipole, const Eigen::Vector3d& p) {
  const auto potential = [&](const Eigen::Vector3d& at) {
    const Eigen::Vector3d r = at - dipole.position;
    return 1e-7 * dipole.moment_per_ampere.dot(r) / std::pow(r.norm(), 3);
  };
  const double h = 0.5e-3;
  Eigen::Vector3d b;
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector3d e = h * Eigen::Vector3d::Unit(axis);
    b[axis] = -((potential(p + 3 * e) - potential(p - 3 * e)) -
                9 * (potential(p + 2 * e) - potential(p - 2 * e)) +
                45 * (potential(p + e) - potential(p - e))) /
              (60 * h);
  }
  return b;
}

Eigen::Matrix<double, 8, 8> scaled(const FieldMatrix& matrix) {
  Eigen::Matrix<double, 8, 8> s = matrix;
  s.bottomRows<5>() *= 20e-3;  // the length that makes gradients comparable with fields (facts 1.4)
  return s;
}

double condition(const Eigen::MatrixXd& m) {
  const Eigen::VectorXd s = Eigen::JacobiSVD<Eigen::MatrixXd>(m).singularValues();
  return s[0] / s[s.size() - 1];
}

TEST(CoilField, gives_at_the_center_the_published_field_per_ampere) {
  const FieldMatrix matrix = CoilField::octomag().matrix({0, 0, 0});
  for (int k = 0; k < 8; ++k) {
    // The eight numbers of the model reproduce the calibration to 1.3 to 2.4 % a coil.
    const double published = k % 2 == 0 ? 2.06e-3 : 2.74e-3;
    EXPECT_NEAR(matrix.col(k).head<3>().norm(), published, 0.024 * published) << "coil " << k;
  }
}

TEST(CoilField, points_at_the_center_where_the_calibration_says) {
  const FieldMatrix matrix = CoilField::octomag().matrix({0, 0, 0});
  for (int k = 0; k < 8; ++k) {
    const Eigen::Vector3d b = matrix.col(k).head<3>();
    const double elevation = std::asin(std::abs(b.z()) / b.norm()) * 180 / std::numbers::pi;
    // 41 to 43 and 8 to 9 degrees measured; two degrees for the model's own misfit.
    EXPECT_NEAR(elevation, k % 2 == 0 ? 42 : 8.5, 2) << "coil " << k;
    EXPECT_EQ(b.z() > 0, k % 2 == 0);  // the lower coils push up, the upper slightly down
  }
}

TEST(CoilField, is_the_gradient_of_the_dipoles_potential) {
  const CoilField field = CoilField::octomag();
  std::mt19937_64 random(1);
  for (int trial = 0; trial < 50; ++trial) {
    const Eigen::Vector3d p = random_place(random, 0.02);
    const FieldMatrix matrix = field.matrix(p);
    for (int k = 0; k < 8; ++k) {
      const Eigen::Vector3d b = from_potential(field.dipoles()[static_cast<std::size_t>(k)], p);
      // Differences of sixth order over 0.5 mm at 80 mm: truncation about 1e-10, rounding about
      // 1e-13.
      EXPECT_LT((matrix.col(k).head<3>() - b).norm(), 1e-8 * b.norm());
    }
  }
}

TEST(CoilField, has_the_gradients_that_differences_of_its_field_give) {
  const CoilField field = CoilField::octomag();
  std::mt19937_64 random(2);
  for (int trial = 0; trial < 50; ++trial) {
    const Eigen::Vector3d p = random_place(random, 0.02);
    const FieldMatrix matrix = field.matrix(p);
    for (int k = 0; k < 8; ++k) {
      const Eigen::Matrix3d g = gradient_matrix(matrix.col(k));
      for (int axis = 0; axis < 3; ++axis) {
        EXPECT_LT((g.col(axis) - differenced(field, p, k, axis)).norm(),
                  1e-8 * g.norm());  // as above
      }
    }
  }
}

TEST(CoilField, has_neither_sources_nor_curl) {
  const CoilField field = CoilField::octomag();
  std::mt19937_64 random(3);
  for (int trial = 0; trial < 50; ++trial) {
    const Eigen::Vector3d p = random_place(random, 0.01);
    for (int k = 0; k < 8; ++k) {
      Eigen::Matrix3d g;
      for (int axis = 0; axis < 3; ++axis) g.col(axis) = differenced(field, p, k, axis);
      EXPECT_LT(std::abs(g.trace()), 1e-9 * g.norm());
      EXPECT_LT((g - g.transpose()).norm(), 1e-9 * g.norm());
    }
  }
}

TEST(CoilField, has_rank_eight_and_the_published_condition_all_over_the_cube) {
  const CoilField field = CoilField::octomag();
  double best = 1e9, worst = 0;
  for (int i = 0; i < 729; ++i) {
    const Eigen::Vector3d p(i % 9 - 4, i / 9 % 9 - 4, i / 81 - 4);
    const double c = condition(scaled(field.matrix(2.5e-3 * p)));
    best = std::min(best, c);
    worst = std::max(worst, c);
  }
  // Facts 1.4, computed from the same eight numbers: only the rounding of the printed figures is
  // between us.
  EXPECT_NEAR(condition(scaled(field.matrix({0, 0, 0}))), 4.98, 0.01);
  EXPECT_NEAR(best, 4.44, 0.01);
  EXPECT_NEAR(worst, 9.95, 0.01);
}

TEST(CoilField, makes_field_and_force_independently_for_every_orientation) {
  const CoilField field = CoilField::octomag();
  std::mt19937_64 random(4);
  std::vector<double> conditions;
  for (int i = 0; i < 125; ++i) {
    const FieldMatrix matrix =
        field.matrix(5e-3 * Eigen::Vector3d(i % 5 - 2, i / 5 % 5 - 2, i / 25 - 2));
    for (int trial = 0; trial < 60; ++trial) {
      Eigen::Matrix<double, 6, 8> a;
      a << matrix.topRows<3>(), 20e-3 * (force_from_field(random_direction(random)) * matrix);
      conditions.push_back(condition(a));
    }
  }
  std::sort(conditions.begin(), conditions.end());
  // Published over 60 other orientations a place: 2.9, 5.1, 12.5. The median moves by hundredths
  // between draws, the extremes by about a tenth of themselves.
  EXPECT_NEAR(conditions.front(), 2.9, 0.3);
  EXPECT_NEAR(conditions[conditions.size() / 2], 5.1, 0.1);
  EXPECT_NEAR(conditions.back(), 12.5, 1.3);
}

TEST(CoilField, is_four_fold_symmetric) {
  const CoilField field = CoilField::octomag();
  Eigen::Matrix3d turn;
  turn << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  std::mt19937_64 random(5);
  for (int trial = 0; trial < 20; ++trial) {
    const Eigen::Vector3d p = random_place(random, 0.01);
    const FieldMatrix here = field.matrix(p), turned = field.matrix(turn * p);
    for (int k = 0; k < 8; ++k) {
      const Eigen::Vector3d b = turn * here.col(k).head<3>();
      EXPECT_LT((turned.col((k + 2) % 8).head<3>() - b).norm(), 1e-12 * b.norm());  // rounding
    }
  }
}

TEST(CoilField, gives_force_as_the_moment_along_the_gradient) {
  std::mt19937_64 random(6);
  const CoilField field = CoilField::octomag();
  for (int trial = 0; trial < 50; ++trial) {
    const FieldGradient f = field.matrix(random_place(random, 0.01)).col(trial % 8);
    const Eigen::Vector3d m = random_direction(random);
    const Eigen::Vector3d force = force_from_field(m) * f;
    EXPECT_LT((force - gradient_matrix(f) * m).norm(),
              1e-14);  // curl-free: (m.grad)B = grad(m.B); rounding
  }
}

TEST(CoilField, perturbs_as_much_as_two_real_calibrations_differ) {
  const CoilField nominal = CoilField::octomag();
  std::mt19937_64 random(7);
  std::vector<double> field_error, gradient_error;
  for (int machine = 0; machine < 60; ++machine) {
    const CoilField truth = nominal.perturbed({}, random);
    Eigen::Matrix<double, 8, 1> change, gain_change, size, gradient_size, gradient_change, dot;
    size.setZero(), dot.setZero(), change.setZero(), gradient_size.setZero(),
        gradient_change.setZero();
    std::vector<FieldMatrix> a, b;
    for (int i = 0; i < 30; ++i) {
      const Eigen::Vector3d p = random_place(random, 0.0075);
      a.push_back(nominal.matrix(p));
      b.push_back(truth.matrix(p));
      size += a.back().topRows<3>().colwise().squaredNorm().transpose();
      dot += a.back().topRows<3>().cwiseProduct(b.back().topRows<3>()).colwise().sum().transpose();
    }
    const Eigen::Matrix<double, 8, 1> gain = dot.cwiseQuotient(size);
    for (std::size_t i = 0; i < a.size(); ++i) {
      const FieldMatrix matched = b[i] - a[i] * gain.asDiagonal();
      change += matched.topRows<3>().colwise().squaredNorm().transpose();
      gradient_change += matched.bottomRows<5>().colwise().squaredNorm().transpose();
      gradient_size += a[i].bottomRows<5>().colwise().squaredNorm().transpose();
    }
    for (int k = 0; k < 8; ++k) {
      field_error.push_back(std::sqrt(change[k] / size[k]));
      gradient_error.push_back(std::sqrt(gradient_change[k] / gradient_size[k]));
    }
  }
  std::sort(field_error.begin(), field_error.end());
  std::sort(gradient_error.begin(), gradient_error.end());
  // Facts 1.2: 2.7 % of field and 4.1 % of gradient in the median, over a sphere and a norm of its
  // own: within 25 %.
  EXPECT_NEAR(field_error[field_error.size() / 2], 0.027, 0.007);
  EXPECT_NEAR(gradient_error[gradient_error.size() / 2], 0.041, 0.010);
}

TEST(CoilField, perturbs_the_same_for_the_same_seed_and_not_at_all_for_zero) {
  const CoilField nominal = CoilField::octomag();
  std::mt19937_64 one(8), same(8), other(9);
  const FieldMatrix a = nominal.perturbed({}, one).matrix({0, 0, 0});
  EXPECT_EQ(a, nominal.perturbed({}, same).matrix({0, 0, 0}));
  EXPECT_NE(a, nominal.perturbed({}, other).matrix({0, 0, 0}));
  const FieldMatrix still = nominal.perturbed({0, 0, 0}, one).matrix({1e-3, 0, 0});
  EXPECT_LT((still - nominal.matrix({1e-3, 0, 0})).norm(), 1e-15);  // a turn by nothing rounds
}

TEST(CoilField, turns_the_axis_without_changing_its_length) {
  const CoilField nominal = CoilField::octomag();
  std::mt19937_64 random(10);
  double sum = 0;
  int count = 0;
  for (int machine = 0; machine < 200; ++machine) {
    const CoilField truth = nominal.perturbed({0, 0, 0.03}, random);
    for (std::size_t k = 0; k < 8; ++k, ++count) {
      const Eigen::Vector3d a = nominal.dipoles()[k].moment_per_ampere,
                            b = truth.dipoles()[k].moment_per_ampere;
      EXPECT_NEAR(b.norm(), a.norm(), 1e-12);  // rounding
      sum += std::pow(std::asin(a.cross(b).norm() / a.squaredNorm()), 2);
    }
  }
  EXPECT_NEAR(std::sqrt(sum / count), 0.03,
              0.002);  // 1600 draws: 1.8 % standard error, here four of them
}

TEST(CoilField, refuses_what_is_no_set_of_coils) {
  EXPECT_THROW(CoilField({}), std::invalid_argument);
  EXPECT_THROW(CoilField(std::vector<Dipole>(9, {{0, 0, 1}, {0, 0, 1}})), std::invalid_argument);
  EXPECT_THROW(CoilField({{{0, 0, kNan}, {0, 0, 1}}}), std::invalid_argument);
  const CoilField one({{{0, 0, 0.1}, {0, 0, 1}}});
  EXPECT_EQ(one.matrix({0, 0, 0}).cols(), 1);
  EXPECT_THROW(one.matrix({kNan, 0, 0}), std::invalid_argument);
  EXPECT_THROW(one.matrix({0, 0, 0.1}), std::invalid_argument);
  std::mt19937_64 random(1);
  EXPECT_THROW(one.perturbed({-1, 0, 0}, random), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
