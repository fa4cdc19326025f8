// Microscopes from a target at several heights: numbers that come back, their stated sigmas, and
// what cannot be told.
// SPDX-License-Identifier: Apache-2.0
#include "optics/calibration/microscope_calibration.h"

#include "optics/chain/viewing_chain.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <stdexcept>
#include <vector>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

struct TrueMicroscope {
  double power = 2.4;  // 1/m
  Eigen::Vector2d tilt{6e-3, -9e-3};
  double pixel = 14.37e-6;
  Eigen::Vector2d center_px{683.2, 519.9};
};

/// Upright. The point of the tilted plane m whose chief ray passes P, by search: m
/// is moved until its ray, built in the world, meets P. No inverse rotation, no closed form.
Eigen::Vector2d pixel_of(const TrueMicroscope& its, const Eigen::Vector3d& P) {
  const auto turned = [&](const Eigen::Vector3d& p) {
    const double y1 = std::cos(its.tilt.x()) * p.y() - std::sin(its.tilt.x()) * p.z();
    const double z1 = std::sin(its.tilt.x()) * p.y() + std::cos(its.tilt.x()) * p.z();
    return Eigen::Vector3d(std::cos(its.tilt.y()) * p.x() + std::sin(its.tilt.y()) * z1, y1,
                           -std::sin(its.tilt.y()) * p.x() + std::cos(its.tilt.y()) * z1);
  };
  Eigen::Vector2d m = P.head<2>();
  for (int i = 0; i < 60; ++i) {
    const Eigen::Vector3d point = turned({m.x(), m.y(), 0});
    const Eigen::Vector3d along = turned({-its.power * m.x(), -its.power * m.y(), 1});
    const Eigen::Vector3d there = point + (P.z() - point.z()) / along.z() * along;
    m += P.head<2>() - there.head<2>();
  }
  return its.center_px + Eigen::Vector2d(m.x(), -m.y()) / its.pixel;
}

std::vector<TargetPoint> target(const TrueMicroscope& its, double noise_px, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::vector<TargetPoint> points;
  for (int k = -2; k <= 2; ++k)
    for (int i = -2; i <= 2; ++i)
      for (int j = -2; j <= 2; ++j) {
        const Eigen::Vector3d place(2e-3 * i, 2e-3 * j, 2e-3 * k);
        points.push_back({place, pixel_of(its, place) +
                                     noise_px * Eigen::Vector2d(normal(random), normal(random))});
      }
  return points;
}

TEST(MicroscopeCalibration, PupilTiltScaleAndCenterComeBack) {
  const TrueMicroscope its;
  const MicroscopeFit fit = fit_microscope(target(its, 0, 1));
  EXPECT_NEAR(fit.pupil_power, its.power, 1e-9);
  EXPECT_NEAR(fit.tilt.x(), its.tilt.x(), 1e-11);
  EXPECT_NEAR(fit.tilt.y(), its.tilt.y(), 1e-11);
  EXPECT_NEAR(fit.pixel, its.pixel, 1e-15);
  EXPECT_LT((fit.center_px - its.center_px).norm(), 1e-8);
  EXPECT_NEAR(fit.rotation, 0, 1e-11);
  EXPECT_LT(fit.max_residual_px, 1e-8);
}

/// An eye's aerial image is inverted, so is what the chain's microscope shows: the chief rays are
/// those of the viewing chain.
TEST(MicroscopeCalibration, HasTheNumbersOfTheViewingChainsMicroscope) {
  NominalChain nominal;
  nominal.prescription = prescription("model_eye_5_3");
  nominal.microscope.pupil_distance = 0.35;
  nominal.microscope.tilt = {4e-3, 7e-3};
  // Without a lens: all indices those of air.
  for (Surface& surface : nominal.prescription.system.surfaces) surface.index = 1;
  const ViewingChain chain(nominal, {}, Eigen::VectorXd(0));
  const System& system = nominal.prescription.system;
  const double plane = system.vertex(system.size()) + nominal.microscope.focus;
  std::vector<TargetPoint> points;
  for (int k = -1; k <= 1; ++k)
    for (int i = -2; i <= 2; ++i)
      for (int j = -2; j <= 2; ++j) {
        const Eigen::Vector2d pixel(60 * i, 60 * j);
        const auto line = chain.line(pixel);
        ASSERT_TRUE(line);
        const double z = plane + 2e-3 * k;
        points.push_back(
            {{(*line)[0] + z * (*line)[2], (*line)[1] + z * (*line)[3], 2e-3 * k}, pixel});
      }
  const MicroscopeFit fit = fit_microscope(points);
  EXPECT_NEAR(fit.pupil_power, 1 / 0.35, 1e-8);
  EXPECT_NEAR(fit.tilt.x(), 4e-3, 1e-9);
  EXPECT_NEAR(fit.tilt.y(), 7e-3, 1e-9);
  EXPECT_NEAR(fit.pixel, nominal.image.pixel, 1e-13);
  EXPECT_NEAR(std::abs(fit.rotation), M_PI, 1e-9);
}

TEST(MicroscopeCalibration, ItsSigmasAreThoseOfTheNoise) {
  const TrueMicroscope its;
  double power = 0;
  double tilt = 0;
  constexpr int kTimes = 200;
  for (unsigned seed = 1; seed <= kTimes; ++seed) {
    const MicroscopeFit fit = fit_microscope(target(its, 0.1, seed));
    power += std::pow((fit.pupil_power - its.power) / fit.pupil_power_sigma, 2) / kTimes;
    tilt += std::pow((fit.tilt.y() - its.tilt.y()) / fit.tilt_sigma.y(), 2) / kTimes;
    EXPECT_LT(fit.pupil_power_sigma, 0.05 * its.power) << "five percent of the pupil's distance";
  }
  // Means of 200 squares of unit variance: 1 within a tenth, to three of its deviations.
  EXPECT_NEAR(power, 1, 0.3);
  EXPECT_NEAR(tilt, 1, 0.3);
}

TEST(MicroscopeCalibration, RefusesATargetThatDoesNotTell) {
  const TrueMicroscope its;
  std::vector<TargetPoint> flat = target(its, 0, 1);
  for (TargetPoint& one : flat) one.position.z() = 0;
  EXPECT_THROW(fit_microscope(flat), std::invalid_argument);
  EXPECT_THROW(fit_microscope(std::vector<TargetPoint>(4)), std::invalid_argument);
  std::vector<TargetPoint> broken = target(its, 0, 1);
  broken[7].pixel_px.x() = std::nan("");
  EXPECT_THROW(fit_microscope(broken), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
