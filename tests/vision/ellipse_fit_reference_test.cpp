// The ellipse fit compared with normal equations, exact ellipses and repeated noise.
// SPDX-License-Identifier: Apache-2.0
#include "vision/ellipse_fit.h"

#include <Eigen/Core>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

using Eigen::Vector2d;
using Five = std::array<double, 5>;
using Square = std::array<Five, 5>;
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kPi = std::numbers::pi;
const Ellipse kStart{{211.3, -47.8}, 31.7, 19.4, 0.7};

// Not in the header, as found: what a normal's deviation has besides, the least scatter, in units
// of the stated deviations, and the least deviation of center and axes.
constexpr double kOwnPx = 0.05;
constexpr double kLeastScatter = 0.5;
constexpr double kLeastPx = 0.02;

/// By turns with pivots; `a` is taken to the identity, `b` to its inverse times what it was.
template <class B>
void eliminate(Square a, std::array<B, 5>& b, auto&& subtract, auto&& divide) {
  for (std::size_t k = 0; k < 5; ++k) {
    std::size_t most = k;
    for (std::size_t i = k; i < 5; ++i)
      if (std::abs(a[i][k]) > std::abs(a[most][k])) most = i;
    std::swap(a[k], a[most]);
    std::swap(b[k], b[most]);
    divide(b[k], a[k][k]);
    const double pivot = a[k][k];
    for (double& x : a[k]) x /= pivot;
    for (std::size_t i = 0; i < 5; ++i) {
      if (i == k) continue;
      const double factor = a[i][k];
      for (std::size_t j = 0; j < 5; ++j) a[i][j] -= factor * a[k][j];
      subtract(b[i], b[k], factor);
    }
  }
}

Five solve(const Square& a, Five b) {
  eliminate(
      a, b, [](double& to, double from, double by) { to -= by * from; },
      [](double& x, double by) { x /= by; });
  return b;
}

Square inverse(const Square& a) {
  Square b{};
  for (std::size_t i = 0; i < 5; ++i) b[i][i] = 1;
  eliminate(
      a, b,
      [](Five& to, const Five& from, double by) {
        for (std::size_t j = 0; j < 5; ++j) to[j] -= by * from[j];
      },
      [](Five& x, double by) {
        for (double& value : x) value /= by;
      });
  return b;
}

/// (u, v, Sxx, Sxy, Syy).
Five parameters(const Ellipse& e) {
  const double c = std::cos(e.angle);
  const double s = std::sin(e.angle);
  const double a = e.semi_major_px;
  const double b = e.semi_minor_px;
  return {e.center_px.x(), e.center_px.y(), a * c * c + b * s * s, (a - b) * c * s,
          a * s * s + b * c * c};
}

/// (u, v, semi-major, semi-minor, angle).
Five axes(const Five& p) {
  const double mean = (p[2] + p[4]) / 2;
  const double spread = std::hypot((p[2] - p[4]) / 2, p[3]);
  return {p[0], p[1], mean + spread, mean - spread, std::atan2(2 * p[3], p[2] - p[4]) / 2};
}

Five row(const Normal& n) {
  const Vector2d& o = n.outward;
  const Vector2d& c = n.circle;
  return {o.x(), o.y(), o.x() * c.x(), o.x() * c.y() + o.y() * c.x(), o.y() * c.y()};
}

double dot(const Five& a, const Five& b) {
  double sum = 0;
  for (std::size_t i = 0; i < 5; ++i) sum += a[i] * b[i];
  return sum;
}

struct Equations {
  Square a{};
  Five b{};
  void add(const Five& of, double value, double information) {
    for (std::size_t i = 0; i < 5; ++i) {
      for (std::size_t j = 0; j < 5; ++j) a[i][j] += information * of[i] * of[j];
      b[i] += information * of[i] * value;
    }
  }
};

/// Distances of `prior` from `start`, along and across its own axes.
void add_prior(Equations& to, const EllipsePrior& prior, const Ellipse& start) {
  const Five mean = parameters(prior.ellipse);
  const Five at = parameters(start);
  Five off{};
  for (std::size_t i = 0; i < 5; ++i) off[i] = mean[i] - at[i];
  const double c = std::cos(prior.ellipse.angle);
  const double s = std::sin(prior.ellipse.angle);
  const double difference = prior.ellipse.semi_major_px - prior.ellipse.semi_minor_px;
  const auto add = [&](const Five& of, double deviation) {
    to.add(of, dot(of, off), 1 / (deviation * deviation));
  };
  add({1, 0, 0, 0, 0}, prior.center_px);
  add({0, 1, 0, 0, 0}, prior.center_px);
  add({0, 0, c * c, 2 * c * s, s * s}, prior.semi_axes_px);
  add({0, 0, s * s, -2 * c * s, c * c}, prior.semi_axes_px);
  add({0, 0, -c * s, c * c - s * s, c * s}, prior.angle * difference);
}

/// Rows and columns to (u, v, a, b, angle), by differences.
Square covariance_of_axes(const Square& c, const Five& at) {
  Square j{};
  for (std::size_t k = 0; k < 5; ++k) {
    Five less = at;
    Five more = at;
    less[k] -= 1e-4;
    more[k] += 1e-4;
    for (std::size_t i = 0; i < 5; ++i) j[i][k] = (axes(more)[i] - axes(less)[i]) / 2e-4;
  }
  Square to{};
  for (std::size_t i = 0; i < 5; ++i)
    for (std::size_t k = 0; k < 5; ++k)
      for (std::size_t m = 0; m < 5; ++m)
        for (std::size_t n = 0; n < 5; ++n) to[i][k] += j[i][m] * c[m][n] * j[k][n];
  return to;
}

/// What the biweight w = (1 - (r / 4.685)^2)^2 hides of the scatter of normal residuals: the fit's
/// true variance E[psi^2] / E[psi']^2, psi = w r (Huber 1981, 7.6), over E[w r^2] / E[w]^2, which
/// the weighted residuals show. Simpson's rule.
double robust_loss() {
  constexpr double kC = 4.685;
  constexpr int kSteps = 2000;
  double w = 0, w_r2 = 0, psi2 = 0, slope = 0;
  for (int i = 0; i <= kSteps; ++i) {
    const double r = kC * (2.0 * i / kSteps - 1);
    const double density = std::exp(-r * r / 2) *
                           (i == 0 || i == kSteps ? 1
                            : i % 2 == 1          ? 4
                                                  : 2) *
                           2 * kC / kSteps / 3 / std::sqrt(2 * kPi);
    const double u = 1 - r * r / (kC * kC);
    w += u * u * density;
    w_r2 += u * u * r * r * density;
    psi2 += std::pow(u * u * r, 2) * density;
    slope += (u * u - 4 * r * r / (kC * kC) * u) * density;
  }
  return psi2 / (slope * slope) / (w_r2 / (w * w));
}

/// Given the weights that the fit ended with.
void expect_least_squares(const Ellipse& start, const std::vector<Normal>& normals,
                          const EllipsePrior* prior, double length, const FittedEllipse& fit) {
  Equations equations;
  double weights = 0;
  for (const Normal& n : normals) {
    if (!n.found) continue;
    weights += n.weight;
    equations.add(row(n), n.shift_px, n.weight / (n.variance + kOwnPx * kOwnPx) / length);
  }
  Equations with_prior = equations;
  if (prior != nullptr) add_prior(with_prior, *prior, start);
  const Five step = solve(with_prior.a, with_prior.b);
  Five at = parameters(start);
  for (std::size_t i = 0; i < 5; ++i) at[i] += step[i];
  const Five wanted = axes(at);
  for (int i = 0; i < 5; ++i) EXPECT_NEAR(fit.ellipse.vector()[i], wanted[i], 1e-9) << i;

  double misfit = 0;
  for (const Normal& n : normals) {
    if (!n.found) continue;
    misfit +=
        n.weight * std::pow(n.shift_px - dot(row(n), step), 2) / (n.variance + kOwnPx * kOwnPx);
  }
  const double scatter =
      std::max(kLeastScatter * kLeastScatter, robust_loss() * misfit / (weights - 5));
  Equations scaled;
  for (std::size_t i = 0; i < 5; ++i)
    for (std::size_t k = 0; k < 5; ++k) scaled.a[i][k] = equations.a[i][k] / scatter;
  if (prior != nullptr) add_prior(scaled, *prior, start);
  Square c = covariance_of_axes(inverse(scaled.a), at);
  // Not more than an angle of which nothing is known: uniform over pi.
  const double share = 1 / (1 + c[4][4] / (kPi * kPi / 12));
  for (std::size_t i = 0; i < 5; ++i) {
    c[i][4] *= std::sqrt(share);
    c[4][i] *= std::sqrt(share);
    if (i < 4) c[i][i] += kLeastPx * kLeastPx;
  }
  for (int i = 0; i < 5; ++i) {
    for (int k = 0; k < 5; ++k) {
      const double size = std::sqrt(c[i][i] * c[k][k]);
      EXPECT_NEAR(fit.covariance(i, k), c[i][k], 1e-7 * size) << i << k;
    }
  }
}

class Draw {
 public:
  explicit Draw(unsigned seed) : random_(seed) {}
  double normal() { return normal_(random_); }
  /// A change of center and shape, as if exactly linear, and noise of the stated variances.
  std::vector<Normal> normals(std::size_t count, const Five& change, double noise = 1) {
    std::vector<Normal> normals(count);
    place_normals(kStart, normals);
    for (Normal& n : normals) {
      n.found = true;
      n.variance = 0.02 + 0.1 * std::abs(normal());
      n.shift_px = dot(row(n), change) + noise * std::sqrt(n.variance) * normal();
      n.contrast = 20;
    }
    return normals;
  }

 private:
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
};

constexpr Five kChange{0.8, -0.5, 0.6, -0.3, -0.4};

TEST(EllipseFitReference, places_normals_at_equal_steps_from_the_major_axis) {
  const double c = std::cos(kStart.angle);
  const double s = std::sin(kStart.angle);
  for (const std::size_t count : {1U, 2U, 7U, 64U}) {
    std::vector<Normal> normals(count);
    for (Normal& n : normals) n = {{3, 4}, {5, 6}, {7, 8}, true, 1.5, 2.5, 3.5, 0.5};
    place_normals(kStart, normals);
    ASSERT_EQ(normals.size(), count);
    for (std::size_t k = 0; k < count; ++k) {
      const double t = 2 * kPi * static_cast<double>(k) / static_cast<double>(count);
      const double x = kStart.semi_major_px * std::cos(t);
      const double y = kStart.semi_minor_px * std::sin(t);
      const Vector2d rim = kStart.center_px + Vector2d(c * x - s * y, s * x + c * y);
      // The tangent, a quarter turn back.
      const double tx = -kStart.semi_major_px * std::sin(t);
      const double ty = kStart.semi_minor_px * std::cos(t);
      const Vector2d tangent(c * tx - s * ty, s * tx + c * ty);
      const Vector2d outward = Vector2d(tangent.y(), -tangent.x()) / tangent.norm();
      const Normal& n = normals[k];
      EXPECT_NEAR((n.rim_px - rim).norm(), 0, 1e-12);
      EXPECT_NEAR((n.outward - outward).norm(), 0, 1e-14);
      EXPECT_NEAR((n.circle - Vector2d(std::cos(t + 0.7), std::sin(t + 0.7))).norm(), 0, 1e-14);
      EXPECT_FALSE(n.found);  // what was found before goes
      EXPECT_EQ(n.shift_px, 0);
      EXPECT_EQ(n.variance, 0);
      EXPECT_EQ(n.contrast, 0);
      EXPECT_EQ(n.weight, 0);
    }
  }
  std::vector<Normal> none;
  place_normals(kStart, none);
  EXPECT_TRUE(none.empty());
}

TEST(EllipseFitReference, is_least_squares_with_the_weights_it_ends_with) {
  Draw draw(11);
  for (const double noise : {0.2, 1.0, 3.0}) {
    for (const std::size_t count : {19U, 48U, 121U}) {
      for (const double length : {1.0, 3.7}) {
        std::vector<Normal> normals = draw.normals(count, kChange, noise);
        for (std::size_t k = 5; k < count; k += 7) normals[k].shift_px += 6;
        if (noise < 1)  // so little is known that the angle's deviation nears that of no knowledge
          for (Normal& n : normals) n.variance *= 300;
        if (count > 20) normals[3].found = normals[17].found = false;
        const FittedEllipse fit = fit_ellipse(kStart, normals, nullptr, length);
        ASSERT_TRUE(fit.valid);
        expect_least_squares(kStart, normals, nullptr, length, fit);
        for (const Normal& n : normals) {
          EXPECT_GE(n.weight, 0);
          EXPECT_LE(n.weight, 1);
          if (!n.found) {
            EXPECT_EQ(n.weight, 0);
          }
          EXPECT_EQ(n.contrast, 20);
        }
      }
    }
  }
}

TEST(EllipseFitReference, a_prior_adds_what_it_knows_in_its_own_axes) {
  Draw draw(12);
  const Ellipse mean{{211.9, -48.9}, 33.1, 18.3, 0.78};
  for (const EllipsePrior& prior : {EllipsePrior{mean, 0.11, 0.07, 0.009},
                                    {mean, 0.3, kInfinity, kInfinity},
                                    {mean, kInfinity, 0.05, kInfinity},
                                    {mean, kInfinity, kInfinity, 0.01}}) {
    for (const double length : {1.0, 6.5}) {
      std::vector<Normal> normals = draw.normals(48, kChange);
      const FittedEllipse fit = fit_ellipse(kStart, normals, &prior, length);
      ASSERT_TRUE(fit.valid);
      expect_least_squares(kStart, normals, &prior, length, fit);
    }
  }
  const EllipsePrior none{mean, kInfinity, kInfinity, kInfinity};
  std::vector<Normal> normals = draw.normals(48, kChange);
  const FittedEllipse without = fit_ellipse(kStart, normals);
  const FittedEllipse with = fit_ellipse(kStart, normals, &none);
  EXPECT_EQ(with.ellipse.vector(), without.ellipse.vector());
  EXPECT_EQ(with.covariance, without.covariance);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
