// SPDX-License-Identifier: Apache-2.0
#include "vision/ellipse.h"

#include "vision/ellipse_fit.h"

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

constexpr double kPi = std::numbers::pi;

Ellipse random_ellipse(std::mt19937_64& random) {
  std::uniform_real_distribution<double> unit(0, 1);
  const double u = unit(random), v = unit(random), a = unit(random), ratio = unit(random),
               turn = unit(random);
  return {
      {100 * u, 100 * v}, 10 + 60 * a, (10 + 60 * a) * (0.3 + 0.65 * ratio), kPi * (turn - 0.5)};
}

// Distances along `from`'s normals to `to`, exactly, by bisection.
void measure(const Ellipse& to, std::vector<Normal>& normals) {
  const Eigen::Matrix2d inverse = to.shape().inverse();
  for (Normal& n : normals) {
    double low = -5, high = 5;
    for (int k = 0; k < 60; ++k) {
      const double middle = (low + high) / 2;
      const bool outside = (inverse * (n.rim_px + middle * n.outward - to.center_px)).norm() > 1;
      (outside ? high : low) = middle;
    }
    n.found = true;
    n.shift_px = low;
    n.variance = 0.01;
  }
}

TEST(Ellipse, lists_its_numbers_in_the_documented_order) {
  const Ellipse e{{1, 2}, 5, 3, 0.4};
  EXPECT_EQ(e.vector(), (Eigen::Matrix<double, 5, 1>() << 1, 2, 5, 3, 0.4).finished());
}

TEST(Ellipse, survives_the_way_through_its_shape) {
  std::mt19937_64 random(1);
  for (int trial = 0; trial < 100; ++trial) {
    const Ellipse e = random_ellipse(random);
    const Ellipse back = Ellipse::from_shape(e.center_px, e.shape());
    EXPECT_LT((back.vector() - e.vector()).norm(),
              1e-9);  // rounding, by the smallest difference of axes
    for (const double t : {0.3, 2.0, 5.0}) {
      EXPECT_NEAR((e.shape().inverse() * (e.point(t) - e.center_px)).norm(), 1, 1e-12);
    }
  }
}

TEST(Ellipse, keeps_its_angle_in_the_half_open_half_turn) {
  const Ellipse upright =
      Ellipse::from_shape({0, 0}, (Eigen::Matrix2d() << 3, -0.0, -0.0, 5).finished());
  EXPECT_DOUBLE_EQ(upright.angle, kPi / 2);
  const Ellipse circle = Ellipse::from_shape({0, 0}, 4 * Eigen::Matrix2d::Identity());
  EXPECT_EQ(circle.angle, 0);
  EXPECT_EQ(circle.semi_major_px, circle.semi_minor_px);
}

TEST(FitEllipse, lands_on_the_ellipse_that_the_distances_come_from) {
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> off(-1, 1);
  for (int trial = 0; trial < 50; ++trial) {
    const Ellipse truth = random_ellipse(random);
    Ellipse e = truth;
    const double du = off(random), dv = off(random), da = off(random), db = off(random),
                 turn = off(random);
    e.center_px += Eigen::Vector2d(du, dv);
    e.semi_major_px += da;
    e.semi_minor_px += 0.5 * db;
    e.angle += 0.05 * turn;
    std::vector<Normal> normals(64);
    for (int round = 0; round < 6; ++round) {
      place_normals(e, normals);
      measure(truth, normals);
      const FittedEllipse fitted = fit_ellipse(e, normals);
      ASSERT_TRUE(fitted.valid);
      e = fitted.ellipse;
    }
    EXPECT_LT((e.shape() - truth.shape()).norm() + (e.center_px - truth.center_px).norm(),
              1e-6);  // converged
  }
}

TEST(FitEllipse, is_not_moved_by_a_quarter_of_wild_distances) {
  std::mt19937_64 random(3);
  const Ellipse truth{{50, 50}, 40, 20, 0.5};
  std::vector<Normal> normals(64);
  place_normals(truth, normals);
  measure(truth, normals);
  for (std::size_t k = 10; k < 26; ++k) normals[k].shift_px = 4 + 0.1 * static_cast<double>(k % 3);
  const FittedEllipse fitted = fit_ellipse(truth, normals);
  ASSERT_TRUE(fitted.valid);
  EXPECT_LT((fitted.ellipse.vector() - truth.vector()).norm(),
            0.05);  // px; the first, gentle rounds leave nothing behind
  for (std::size_t k = 12; k < 24; ++k) EXPECT_EQ(normals[k].weight, 0);
}

TEST(FitEllipse, states_the_scatter_that_its_distances_cause) {
  std::mt19937_64 random(4);
  std::normal_distribution<double> noise(0, 0.3);
  const Ellipse truth{{50, 50}, 40, 20, 0.5};
  Eigen::Matrix<double, 5, 5> scatter = Eigen::Matrix<double, 5, 5>::Zero(), said = scatter;
  const int trials = 400;
  for (int trial = 0; trial < trials; ++trial) {
    std::vector<Normal> normals(64);
    place_normals(truth, normals);
    for (Normal& n : normals) {
      n.found = true;
      n.shift_px = noise(random);
      n.variance = 0.09;
    }
    const FittedEllipse fitted = fit_ellipse(truth, normals);
    const Eigen::Matrix<double, 5, 1> off = fitted.ellipse.vector() - truth.vector();
    scatter += off * off.transpose() / trials;
    said += fitted.covariance / trials;
  }
  // 400 draws: 7 % of a variance; Tukey's weights and the systematic floor explain the rest.
  for (int k = 0; k < 5; ++k) EXPECT_NEAR(said(k, k) / scatter(k, k), 1, 0.35) << k;
}

TEST(FitEllipse, calls_the_angle_of_a_circle_unknown_and_stays_finite) {
  const Ellipse circle{{50, 50}, 20, 20, 0};
  std::vector<Normal> normals(64);
  place_normals(circle, normals);
  for (Normal& n : normals) {
    n.found = true;
    n.variance = 0.01;
  }
  const FittedEllipse fitted = fit_ellipse(circle, normals);
  ASSERT_TRUE(fitted.valid);
  EXPECT_TRUE(fitted.covariance.allFinite());
  EXPECT_NEAR(fitted.covariance(4, 4), kPi * kPi / 12, 0.01);  // uniform over half a turn
}

TEST(FitEllipse, gives_nothing_from_too_few_normals) {
  const Ellipse e{{50, 50}, 20, 10, 0};
  std::vector<Normal> normals(64);
  place_normals(e, normals);
  for (std::size_t k = 0; k < 20; ++k) normals[k].found = true;
  EXPECT_FALSE(fit_ellipse(e, normals).valid);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
