// The exact projection against traced chief rays, its edges, its derivatives, and the localizer
// that sees through it.
// SPDX-License-Identifier: Apache-2.0
#include "optics/projection/exact_projection.h"

#include "optics/pose/pose.h"
#include "tests/optics/pose/exact_silhouette.h"
#include "tests/optics/pose/pose_support.h"
#include "tests/optics/support.h"

#include <ceres/jet.h>
#include <gtest/gtest.h>

#include <cmath>
#include <iostream>
#include <limits>
#include <random>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

Microscope askew() {
  Microscope microscope;
  microscope.pupil_distance = 0.15;
  microscope.decenter = {0.4 * kMm, 0.3 * kMm};
  microscope.tilt = {0.02, 0.01};
  return microscope;
}

/// How far from `m` the traced chief ray of the chain puts the point, in the aerial image: the line
/// of m is traced, and what it misses the point by is taken back to the image.
double error_in_image(const System& system, const Microscope& microscope,
                      const Eigen::Vector3d& point, const ExactProjection::WithJacobian& seen) {
  const auto line = isopixel_line(system, microscope, seen.m);
  if (!line) return std::numeric_limits<double>::infinity();
  const Eigen::Vector3d there =
      line->origin + line->direction * ((point.z() - line->origin.z()) / line->direction.z());
  return (seen.per_point * (point - there)).norm();
}

TEST(ExactProjection, TenThousandRandomPointsAreWithinAMicrometreOfTheirTracedChiefRay) {
  struct Case {
    System system;
    Microscope microscope;
    bool tabulated;
  };
  Microscope near;
  near.pupil_distance = 0.1;
  Microscope shifted;
  shifted.decenter = {0.5 * kMm, -0.2 * kMm};
  const System model = model_eye_5_3(), navarro = navarro_with_condensing_lens(true);
  for (const Case& chain : {Case{model, {}, false}, Case{model, {}, true}, Case{model, near, false},
                            Case{model, shifted, false}, Case{model, askew(), false},
                            Case{navarro, {}, false}, Case{navarro, askew(), false}}) {
    const ExactProjection exact(chain.system, chain.microscope, 7 * kMm, chain.tabulated);
    std::mt19937 generator(3);
    std::uniform_real_distribution<double> uniform(-1, 1);
    double worst = 0;
    int valid = 0;
    while (valid < 10000) {
      const Eigen::Vector3d p(8 * kMm * uniform(generator), 8 * kMm * uniform(generator),
                              8 * kMm * (uniform(generator) + 1));
      const auto seen = exact.project_with_jacobian(p);
      if (!seen) continue;
      ++valid;
      worst = std::max(worst, error_in_image(chain.system, chain.microscope, p, *seen));
    }
    std::cout << (exact.symmetric() ? "polynomials" : "grid") << ": worst " << worst / kUm
              << " um, own check " << exact.max_residual() / kUm << " um\n";
    EXPECT_LT(
        worst,
        0.3 * kUm);  // the issue asks for 1; seen 1e-10 um by polynomials, 0.15 on the grid's edge
    EXPECT_LT(exact.max_residual(), 0.3 * kUm);
  }
}

TEST(ExactProjection, GridAndPolynomialsAgree) {
  const ExactProjection polynomials(model_eye_5_3(), {}, 7 * kMm),
      grid(model_eye_5_3(), {}, 7 * kMm, true);
  for (const Eigen::Vector3d& p :
       {Eigen::Vector3d(0, 0, 4), Eigen::Vector3d(3, -1, 2), Eigen::Vector3d(-4, 2, 8)}) {
    EXPECT_LT((*polynomials.project(p * kMm) - *grid.project(p * kMm)).norm(), 0.05 * kUm);
  }
}

TEST(ExactProjection, TheLineOfAnImagePointPassesEveryPointThatItShows) {
  for (const Microscope& microscope : {Microscope{}, askew()}) {
    const ExactProjection exact(model_eye_5_3(), microscope, 7 * kMm);
    const Eigen::Vector2d m(3 * kMm, -2 * kMm);
    for (const double z : {2 * kMm, 5 * kMm, 9 * kMm}) {
      const Ray line = *exact.line(m, z);
      EXPECT_DOUBLE_EQ(line.origin.z(), z);
      EXPECT_LT((*exact.project(line.origin) - m).norm(), 1e-10);  // both from the same table
    }
  }
}

TEST(ExactProjection, JacobianAndJetsAreTheDerivativeOfTheProjection) {
  using Jet = ceres::Jet<double, 3>;
  for (const Microscope& microscope : {Microscope{}, askew()}) {
    const ExactProjection exact(model_eye_5_3(), microscope, 7 * kMm);
    for (const Eigen::Vector3d& p :
         {Eigen::Vector3d(0, 0, 4), Eigen::Vector3d(3, -1, 2), Eigen::Vector3d(-4, 2, 8)}) {
      const Eigen::Vector3d point = p * kMm;
      const auto seen = exact.project_with_jacobian(point);
      ASSERT_TRUE(seen);
      detail::Vector2<Jet> m;
      ASSERT_TRUE(exact.project(
          detail::Vector3<Jet>(Jet(point.x(), 0), Jet(point.y(), 1), Jet(point.z(), 2)), m));
      for (int k = 0; k < 3; ++k) {
        const Eigen::Vector3d step = 1 * kUm * Eigen::Vector3d::Unit(k);
        const Eigen::Vector2d change =
            (*exact.project(point + step) - *exact.project(point - step)) / (2 * kUm);
        EXPECT_LT((seen->per_point.col(k) - change).norm(),
                  1e-5);  // central differences, and the grid's nanometers
        EXPECT_NEAR(m.x().v[k], seen->per_point(0, k), 1e-9);
        EXPECT_NEAR(m.y().v[k], seen->per_point(1, k), 1e-9);
      }
    }
  }
}

TEST(ExactProjection, OutsideItsValidityItSaysNothing) {
  const System system = model_eye_5_3();
  const ExactProjection exact(system, {}, 7 * kMm);
  for (const Eigen::Vector3d& p :
       {Eigen::Vector3d(0, 0, -0.01 * kMm),
        Eigen::Vector3d(5 * kMm, 0, 0.2 * kMm),  // behind the retina
        Eigen::Vector3d(0, 0, 15.6 * kMm),       // in the lens
        Eigen::Vector3d(9 * kMm, 0, 5 * kMm), Eigen::Vector3d(50 * kMm, 0, 5 * kMm)}) {
    EXPECT_FALSE(exact.project(p)) << p.transpose();
  }
  EXPECT_FALSE(exact.line({7.1 * kMm, 0}));
  EXPECT_TRUE(exact.project(Eigen::Vector3d(0, 0, 0)));
}

// The eye is the same all round, so turning the microscope by 90 degrees turns the lines, and they
// cross at the same depth, whichever meridian of m that is in.
TEST(ExactProjection, TheDepthAtWhichLinesCrossIsSoughtInEveryMeridian) {
  Microscope one;
  one.pupil_distance = 0.02;
  one.tilt = {0.03, 0};
  Microscope turned = one;
  turned.tilt = {0, 0.03};
  const ExactProjection exact(model_eye_5_3(), one, 7 * kMm);
  EXPECT_LT(exact.max_z(), 13 * kMm);  // before the lens
  // the tables' cubics, at nodes that are turned into one another
  EXPECT_NEAR(ExactProjection(model_eye_5_3(), turned, 7 * kMm).max_z(), exact.max_z(), 1e-9);
  for (const Eigen::Vector2d& tilt : {Eigen::Vector2d(-0.03, 0), Eigen::Vector2d(0, -0.03)}) {
    turned.tilt = tilt;
    EXPECT_NEAR(ExactProjection(model_eye_5_3(), turned, 7 * kMm).max_z(), exact.max_z(), 1e-9);
  }
}

TEST(ExactProjection, TheIrisEndsTheTable) {
  System system = model_eye_5_3();
  Microscope microscope;
  microscope.pupil_distance = 0.1;
  const ExactProjection wide(system, microscope, 7 * kMm);
  system.stop->radius = 0.2 * kMm;
  const ExactProjection narrow(system, microscope, 7 * kMm);
  EXPECT_LT(narrow.max_m(), wide.max_m());
  EXPECT_FALSE(isopixel_line(system, microscope, {narrow.max_m() + 0.2 * kMm, 0}));
}

TEST(ExactProjection, RefusesBadArguments) {
  const System system = model_eye_5_3();
  expect_refused("max_m", [&] { ExactProjection(system, {}, kNan); });
  expect_refused("max_m", [&] { ExactProjection(system, {}, 60 * kMm); });
  Microscope bad;
  bad.numerical_aperture = 2;
  expect_refused("numerical_aperture", [&] { ExactProjection(system, bad, 7 * kMm); });
  const ExactProjection exact(system, {}, 7 * kMm);
  expect_refused("point_in_eye", [&] { (void)exact.project(Eigen::Vector3d(0, kNan, 0)); });
  expect_refused("m", [&] { (void)exact.line({kNan, 0}); });
}

/// rms of the localization of exact silhouettes round the 8 mm by 6 mm square of figure 6.5.
double square_rms(const PoseSettings& settings, const Microscope& microscope,
                  const Eigen::Vector3d& axis) {
  const ExactScene scene{model_eye_5_3(), microscope, settings.image, settings.robot};
  double squares = 0;
  int count = 0;
  for (double x = -4; x <= 4; x += 1) {
    for (double z = 2; z <= 8; z += 1) {
      if (std::abs(x) < 4 && z > 2 && z < 8) continue;
      const Eigen::Vector3d place(x * kMm, 0, z * kMm);
      const EllipseVector near = *project_spheroid(settings, place, axis);
      const EllipseVector seen = fit_ellipse(exact_contour(scene, place, axis, near), near, true);
      const auto found =
          locate(settings, seen, tracker_noise(), axis, *first_guess(settings, seen, axis));
      if (!found) return std::numeric_limits<double>::infinity();
      squares += (found->position_in_eye - place).squaredNorm();
      ++count;
    }
  }
  return std::sqrt(squares / count);
}

TEST(ExactPose, ExactSilhouettesOverTheSquareAreLocalizedToAFewMicrometres) {
  PoseSettings settings = default_settings();
  for (const Microscope& microscope : {Microscope{}, askew()}) {
    settings.exact.emplace(model_eye_5_3(), microscope, 8 * kMm);
    for (const Eigen::Vector3d& axis : {kAlongX, kAlongZ, Eigen::Vector3d(kOblique.normalized())}) {
      const double rms = square_rms(settings, microscope, axis);
      std::cout << "exact projection over the square: rms " << rms / kUm << " um\n";
      // 52 um by the single viewpoint; seen 0.1 to 2.2, from the way the ellipse is fitted
      EXPECT_LT(rms, 5 * kUm);
    }
  }
}

TEST(ExactPose, LocateReturnsThePlaceThatWasProjectedWithItsCovariance) {
  PoseSettings settings = default_settings();
  settings.projection = {};  // not used, so not checked
  settings.exact.emplace(model_eye_5_3(), Microscope{}, 8 * kMm);
  const Eigen::Vector3d place(2 * kMm, -1 * kMm, 5 * kMm);
  const auto shown = project_spheroid(settings, place, kAlongX);
  ASSERT_TRUE(shown);
  const auto found =
      locate(settings, *shown, tracker_noise(), kAlongX, *first_guess(settings, *shown, kAlongX));
  ASSERT_TRUE(found);
  EXPECT_LT((found->position_in_eye - place).norm(),
            0.01 * kUm);  // what the solver's tolerances leave
  // Facts 9: 0.2 px on the full axis is some 20 um of depth for a robot lying along x, so on the
  // semi-axis 40, here with the minor axis' help; across it is far less.
  EXPECT_NEAR(std::sqrt(found->covariance(2, 2)), 40 * kUm, 8 * kUm);
  EXPECT_LT(std::sqrt(found->covariance(0, 0)), 12 * kUm);
}

TEST(ExactPose, OutsideTheTableThereIsNoAnswer) {
  PoseSettings settings = default_settings();
  settings.exact.emplace(model_eye_5_3(), Microscope{}, 7 * kMm);
  EXPECT_FALSE(project_spheroid(settings, {12 * kMm, 0, 5 * kMm}, kAlongX));
  EXPECT_FALSE(project_spheroid(settings, {0, 0, -1 * kMm}, kAlongX));
  EllipseVector far;
  far << 5000, 500, 80, 40, 0;
  EXPECT_FALSE(first_guess(settings, far, kAlongX));
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
