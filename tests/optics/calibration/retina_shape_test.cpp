// Retinas of known shape from their points, with and without noise, and points that cannot say.
// SPDX-License-Identifier: Apache-2.0
#include "optics/calibration/retina_shape.h"

#include "tests/optics/support.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <vector>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

std::vector<Eigen::Vector3d> points_on(const Surface& retina, const Eigen::Vector3d& vertex,
                                       double noise = 0, unsigned seed = 1) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal(0, 1);
  std::vector<Eigen::Vector3d> points;
  for (int ring = 0; ring <= 6; ++ring) {
    for (int i = 0; i < 12; ++i) {
      const double r = ring * 1.2 * kMm, phi = 2 * std::numbers::pi * i / 12 + 0.3 * ring;
      Eigen::Vector3d point =
          vertex + Eigen::Vector3d(r * std::cos(phi), r * std::sin(phi), retina.sag(r));
      for (int k = 0; k < 3; ++k) point[k] += noise * normal(random);
      points.push_back(point);
    }
  }
  return points;
}

TEST(RetinaShape, PointsOfASurfaceGiveItBack) {
  for (double conic : {-0.175, 0.0, 0.4, -1.0, -1.5}) {
    const Eigen::Vector3d vertex(0.3 * kMm, -0.2 * kMm, 0.15 * kMm);
    const RetinaFit fit = fit_retina(points_on(make_surface(12 * kMm, conic, 0, 1), vertex));
    EXPECT_NEAR((fit.vertex - vertex).norm(), 0, 1e-12)
        << conic;  // fourteen digits of lengths of 10 mm
    EXPECT_NEAR(fit.radius, 12 * kMm, 1e-11);
    EXPECT_NEAR(fit.conic, conic, 1e-8);  // it weighs little in a third of a sphere
    EXPECT_LT(fit.max_residual, 1e-14);
  }
}

// A power of two changes no digit, so the same steps must be taken at any size.
TEST(RetinaShape, TheSizeOfTheEyeDoesNotMatter) {
  const double size = std::ldexp(1.0, -16);
  RetinaFitOptions options;
  options.fit_conic = false;  // a number without unit, whose steps would outweigh small lengths
  std::vector<Eigen::Vector3d> points =
      points_on(make_surface(12 * kMm, -0.175, 0, 1), {0, 0, 0}, 20 * kUm);
  const RetinaFit fit = fit_retina(points, options);
  for (Eigen::Vector3d& point : points) point *= size;
  const RetinaFit small = fit_retina(points, options);
  EXPECT_EQ(small.vertex, size * fit.vertex);
  EXPECT_EQ(small.radius, size * fit.radius);
}

TEST(RetinaShape, HeldParametersStay) {
  RetinaFitOptions options;
  options.fit_conic = options.fit_center = false;
  options.conic = -0.175;
  const RetinaFit fit =
      fit_retina(points_on(make_surface(11 * kMm, -0.175, 0, 1), {0, 0, 0.2 * kMm}), options);
  EXPECT_EQ(fit.conic, -0.175);
  EXPECT_EQ(fit.vertex.x(), 0);
  EXPECT_NEAR(fit.vertex.z(), 0.2 * kMm, 1e-13);
  EXPECT_NEAR(fit.radius, 11 * kMm, 1e-12);
  EXPECT_EQ(fit.covariance(4, 4), 0);
}

TEST(RetinaShape, TheCovarianceSaysHowFarNoiseCarries) {
  const Surface retina = make_surface(12 * kMm, -0.175, 0, 1);
  constexpr int kRuns = 200;
  Eigen::Matrix<double, 5, 1> truth, squares = Eigen::Matrix<double, 5, 1>::Zero();
  truth << 0, 0, 0, 12 * kMm, -0.175;
  Eigen::Matrix<double, 5, 1> predicted = squares;
  for (int run = 0; run < kRuns; ++run) {
    const RetinaFit fit =
        fit_retina(points_on(retina, Eigen::Vector3d::Zero(), 20 * kUm, 100 + run));
    Eigen::Matrix<double, 5, 1> found;
    found << fit.vertex, fit.radius, fit.conic;
    squares += (found - truth).cwiseAbs2() / kRuns;
    predicted += fit.covariance.diagonal() / kRuns;
  }
  for (int i = 0; i < 5; ++i) {
    // Variance of 200 runs is known to 10 %; three of that, and the bias of noise in all
    // directions.
    EXPECT_NEAR(squares[i] / predicted[i], 1, 0.4) << i;
  }
}

TEST(RetinaShape, PointsThatCannotSayAreRefused) {
  const auto refused = [](const std::vector<Eigen::Vector3d>& points) {
    expect_refused("points", [&] { (void)fit_retina(points); });
  };
  const auto good = points_on(make_surface(12 * kMm, 0, 0, 1), Eigen::Vector3d::Zero());
  refused({good.begin(), good.begin() + 4});
  refused(std::vector<Eigen::Vector3d>(10, good[20]));
  refused({good.begin() + 24, good.begin() + 36});  // one ring
  std::vector<Eigen::Vector3d> line, bad = good, turned = good;
  for (int i = 0; i < 10; ++i) line.emplace_back(i * kMm, 2 * i * kMm, 0.5 * i * kMm);
  refused(line);
  bad[3].y() = kNan;
  refused(bad);
  for (Eigen::Vector3d& point : turned) point.z() = -point.z();
  refused(turned);
  RetinaFitOptions options;
  options.conic = kNan;
  expect_refused("conic", [&] { (void)fit_retina(good, options); });
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
