// Ellipse fits of exact ellipses, outliers and noise, refusals, and the autocorrelation of a rim.
// SPDX-License-Identifier: Apache-2.0
#include "vision/ellipse_fit.h"

#include <Eigen/Core>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

using Eigen::Vector2d;
constexpr double kPi = std::numbers::pi;
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
const Ellipse kStart{{211.3, -47.8}, 31.7, 19.4, 0.7};

/// How far along the normal `target` is: the nearer root of the quadratic equation.
double distance(const Normal& n, const Ellipse& target) {
  const auto turned = [&](const Vector2d& x) {
    return Vector2d(
        (std::cos(target.angle) * x.x() + std::sin(target.angle) * x.y()) / target.semi_major_px,
        (std::cos(target.angle) * x.y() - std::sin(target.angle) * x.x()) / target.semi_minor_px);
  };
  const Vector2d from = turned(n.rim_px - target.center_px);
  const Vector2d along = turned(n.outward);
  const double a = along.squaredNorm();
  const double b = from.dot(along);
  const double c = from.squaredNorm() - 1;
  return -c / (b + std::copysign(std::sqrt(b * b - a * c), b));
}

std::vector<Normal> look(const Ellipse& start, const Ellipse& target, std::size_t count,
                         double variance) {
  std::vector<Normal> normals(count);
  place_normals(start, normals);
  for (Normal& n : normals) {
    n.found = true;
    n.shift_px = distance(n, target);
    n.variance = variance;
  }
  return normals;
}

TEST(EllipseFitReference, repeated_looks_end_on_the_exact_ellipse) {
  for (const Ellipse& target : {Ellipse{{213.1, -49.5}, 34.2, 17.6, 0.81},
                                {{208.4, -46.2}, 28.3, 21.9, 0.2},
                                {{212.5, -50.6}, 33.3, 20.1, -1.2}}) {
    for (const std::size_t count : {11U, 64U, 501U}) {
      Ellipse ellipse = kStart;
      for (int round = 0; round < 25; ++round) {
        std::vector<Normal> normals = look(ellipse, target, count, 0.04);
        const FittedEllipse fit = fit_ellipse(ellipse, normals);
        ASSERT_TRUE(fit.valid);
        ellipse = fit.ellipse;
      }
      EXPECT_NEAR((ellipse.vector() - target.vector()).norm(), 0, 1e-9);
    }
  }
}

TEST(EllipseFitReference, outliers_get_no_weight_and_move_nothing) {
  const Ellipse target{{211.5, -47.6}, 32.0, 19.2, 0.71};
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  std::vector<Normal> normals = look(kStart, target, 60, 0.04);
  for (std::size_t k = 0; k < normals.size(); ++k) {
    normals[k].shift_px += 0.2 * normal(random);
    if (k % 3 == 1) normals[k].shift_px = 5 + 0.1 * static_cast<double>(k % 11);
  }
  const FittedEllipse fit = fit_ellipse(kStart, normals);
  ASSERT_TRUE(fit.valid);
  EXPECT_NEAR((fit.ellipse.vector() - target.vector()).norm(), 0, 0.2);
  double least = 1;
  for (std::size_t k = 0; k < normals.size(); ++k) {
    if (k % 3 == 1) {
      EXPECT_EQ(normals[k].weight, 0);
    } else {
      least = std::min(least, normals[k].weight);
    }
  }
  EXPECT_GT(least, 0.2);
  EXPECT_LT(least, 0.95);
}

TEST(EllipseFitReference, the_covariance_is_about_that_of_repeated_noise) {
  const Ellipse target{{211.6, -48.1}, 32.3, 19.0, 0.72};
  std::mt19937_64 random(8);
  std::normal_distribution<double> normal;
  for (const double length : {1.0, 2.0}) {
    using Five = Eigen::Matrix<double, 5, 1>;
    constexpr int kTrials = 1200;
    Eigen::Matrix<double, 5, 5> stated = Eigen::Matrix<double, 5, 5>::Zero();
    Eigen::Matrix<double, 5, 5> seen = stated;
    Five mean = Five::Zero();
    for (int trial = 0; trial < kTrials; ++trial) {
      std::vector<Normal> normals = look(kStart, target, 64, 0.5);
      double before = 0;
      for (std::size_t k = 0; k < normals.size(); ++k) {
        Normal& n = normals[k];
        n.variance = k % 4 < 2 ? 0.3 : 0.9;
        // With a length of two, neighbors err together.
        if (length == 1 || k % 2 == 0) before = normal(random);
        n.shift_px += std::sqrt(n.variance) * before;
      }
      const FittedEllipse fit = fit_ellipse(kStart, normals, nullptr, length);
      ASSERT_TRUE(fit.valid);
      const Five off = fit.ellipse.vector() - target.vector();
      mean += off / kTrials;
      seen += off * off.transpose() / kTrials;
      stated += fit.covariance / kTrials;
    }
    // Too small where neighbors err together: the five unknowns take more of fewer errors.
    for (int i = 0; i < 5; ++i) {
      EXPECT_GT(stated(i, i) / seen(i, i), length == 1 ? 0.86 : 0.7) << i;
      EXPECT_LT(stated(i, i) / seen(i, i), 1.15) << i;
      EXPECT_LT(std::abs(mean[i]), 0.3 * std::sqrt(seen(i, i)));
      for (int k = 0; k < i; ++k)
        EXPECT_NEAR(stated(i, k), seen(i, k), 0.15 * std::sqrt(seen(i, i) * seen(k, k)));
    }
  }
}

TEST(EllipseFitReference, too_few_normals_are_not_valid) {
  struct Case {
    std::size_t found;
    std::size_t count;
    bool valid;
  };
  for (const Case& c : {Case{23, 64, true},
                        {22, 64, false},
                        {14, 40, true},
                        {13, 40, false},
                        {35, 100, true},
                        {34, 100, false},
                        {8, 20, true},
                        {7, 20, false},
                        {8, 8, true},
                        {7, 7, false},
                        {1024, 1024, true},
                        {1025, 1025, false},
                        {0, 64, false},
                        {0, 0, false}}) {
    std::vector<Normal> normals = look(kStart, kStart, c.count, 0.1);
    for (Normal& n : normals) n.found = false;
    for (std::size_t k = 0; k < c.found; ++k) normals[k * c.count / c.found].found = true;
    EXPECT_EQ(fit_ellipse(kStart, normals).valid, c.valid) << c.found << " of " << c.count;
  }
}

TEST(EllipseFitReference, what_is_no_ellipse_is_not_valid) {
  for (const double shift : {-5.0, -18.0, -19.6, -25.0, -40.0, kNan}) {
    std::vector<Normal> normals = look(kStart, kStart, 64, 0.1);
    for (Normal& n : normals) n.shift_px = shift;
    EXPECT_EQ(fit_ellipse(kStart, normals).valid, shift > -18.5) << shift;
  }
  for (const double length : {0.0, -2.0, kInfinity, kNan}) {
    std::vector<Normal> normals = look(kStart, kStart, 64, 0.1);
    EXPECT_FALSE(fit_ellipse(kStart, normals, nullptr, length).valid) << length;
  }
}

TEST(EllipseFitReference, an_axis_shorter_than_a_pixel_is_not_valid) {
  const Ellipse start{{211.3, -47.8}, 31.7, 19.4, 0};
  for (const double minor : {2.0, 1.01, 0.99, 0.3, -1.5}) {
    std::vector<Normal> normals = look(start, start, 64, 0.1);
    for (Normal& n : normals) n.shift_px = n.outward.y() * n.circle.y() * (minor - 19.4);
    const FittedEllipse fit = fit_ellipse(start, normals);
    EXPECT_EQ(fit.valid, minor > 1) << minor;
    if (fit.valid) {
      EXPECT_NEAR(fit.ellipse.semi_minor_px, minor, 1e-9);
    }
  }
}

TEST(EllipseFitReference, a_circle_has_no_angle) {
  const Ellipse circle{{31.2, 18.7}, 14.3, 14.3, 0.4};
  std::vector<Normal> normals = look(circle, circle, 48, 0.02);
  const FittedEllipse fit = fit_ellipse(circle, normals);
  ASSERT_TRUE(fit.valid);
  EXPECT_NEAR(fit.covariance(4, 4), kPi * kPi / 12, 1e-3);
  EXPECT_TRUE(fit.covariance.allFinite());
  EXPECT_NEAR(fit.ellipse.semi_major_px, 14.3, 1e-9);
  EXPECT_NEAR(fit.ellipse.semi_minor_px, 14.3, 1e-9);
}

/// Weighted mean taken off, weights to both of a pair, up to `last`.
double autocorrelation(const std::vector<Normal>& normals, std::size_t last) {
  double weights = 0;
  double mean = 0;
  for (const Normal& n : normals) weights += n.weight, mean += n.weight * n.shift_px;
  mean /= weights;
  const std::size_t count = normals.size();
  const auto lag = [&](std::size_t k) {
    double sum = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const Normal& a = normals[(i + k) % count];
      const Normal& b = normals[i];
      sum += a.weight * b.weight * (a.shift_px - mean) * (b.shift_px - mean);
    }
    return sum;
  };
  double sum = 1;
  for (std::size_t k = 1; k <= last && lag(k) > 0; ++k) sum += 2 * lag(k) / lag(0);
  return sum;
}

std::vector<Normal> rim(std::size_t count, unsigned seed, std::size_t smooth) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> share(0.05, 1);
  std::vector<double> raw(count);
  for (double& x : raw) x = normal(random);
  std::vector<Normal> normals(count);
  for (std::size_t i = 0; i < count; ++i) {
    normals[i].found = true;
    normals[i].variance = 0.1 + share(random);
    normals[i].weight = share(random);
    normals[i].shift_px = 0.4;
    for (std::size_t k = 0; k < smooth; ++k) normals[i].shift_px += raw[(i + k) % count];
  }
  normals[count / 2].weight = 0;
  return normals;
}

TEST(EllipseFitReference, autocorrelation_is_summed_to_the_first_that_is_not_positive) {
  int cut = 0;
  for (unsigned seed = 1; seed <= 20; ++seed) {
    for (const std::size_t smooth : {1U, 3U, 6U}) {
      const std::vector<Normal> normals = rim(96, seed, smooth);
      const double wanted = autocorrelation(normals, 16);
      EXPECT_NEAR(integrated_autocorrelation(normals), wanted, 1e-11 * wanted);
      cut += autocorrelation(normals, 95) == wanted;
    }
  }
  EXPECT_GT(cut, 50);
  // Of nothing, of the same everywhere, of no weight: independent.
  EXPECT_EQ(integrated_autocorrelation({}), 1);
  std::vector<Normal> normals = rim(24, 1, 3);
  for (Normal& n : normals) n.weight = 0;
  EXPECT_EQ(integrated_autocorrelation(normals), 1);
  for (Normal& n : normals) n.weight = 1, n.shift_px = 2;
  EXPECT_EQ(integrated_autocorrelation(normals), 1);
}

TEST(EllipseFitReference, autocorrelation_is_summed_over_a_sixth_of_the_rim_at_most) {
  for (const std::size_t count : {8U, 11U, 12U, 17U, 18U, 64U, 100U}) {
    std::vector<Normal> normals(count);
    for (std::size_t i = 0; i < count; ++i) {
      normals[i].found = true;
      normals[i].weight = 1;
      normals[i].shift_px = std::cos(2 * kPi * static_cast<double>(i) / static_cast<double>(count));
    }
    EXPECT_NEAR(integrated_autocorrelation(normals), autocorrelation(normals, count / 6), 1e-11);
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
