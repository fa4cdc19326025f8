// Ray aiming, spots and the curves over the field, against the published rows of facts/optics 2
// and 3.
// SPDX-License-Identifier: Apache-2.0
#include "optics/analysis/field_curves.h"

#include "tests/optics/support.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

std::vector<double> field() {
  std::vector<double> angles;
  for (int degrees = 0; degrees <= 35; degrees += 5) angles.push_back(degrees * kDegree);
  return angles;
}

void expect_row(const System& system, const std::vector<Eigen::Vector2d>& samples,
                const std::vector<double>& row_mm) {
  const PupilTracer tracer(system, Pupil::of_stop(system));
  const auto curve = field_curves(tracer, field(), samples);
  ASSERT_EQ(curve.size(), row_mm.size());
  for (std::size_t i = 0; i < curve.size(); ++i) {
    // 2 um is what the issue asks; the row is printed to 1 um, and the difference seen is below
    // that.
    EXPECT_NEAR(curve[i].best_focus, row_mm[i] * kMm, 1 * kUm)
        << curve[i].angle / kDegree << " degrees";
    EXPECT_EQ(curve[i].transmitted, 1);
  }
}

TEST(FieldCurves, RowAOfTheFactsIsReproduced) {
  expect_row(navarro_with_condensing_lens(true), disc_samples(),
             {8.091, 8.065, 8.000, 7.926, 7.882, 7.894, 7.976, 8.231});
}

TEST(FieldCurves, RowAPrimeWithTheMeridionalFanIsReproduced) {
  expect_row(navarro_with_condensing_lens(true), fan_samples(),
             {8.073, 8.055, 8.017, 8.011, 8.094, 8.302, 8.642, 9.272});
}

TEST(FieldCurves, RowOWithTheStopAtThePosteriorSurfaceIsReproduced) {
  System system = navarro_with_condensing_lens(true);
  system.stop->surface = 2;
  // The field angle counts from the center of this stop.
  expect_row(system, fan_samples(), {8.142, 8.233, 8.459, 8.684, 8.723, 8.426, 7.792, 5.654});
}

TEST(FieldCurves, TheRowWithoutAsphereIsReproduced) {
  expect_row(navarro_with_condensing_lens(false), disc_samples(),
             {8.117, 8.101, 8.069, 8.064, 8.150, 8.400, 8.881, 9.620});
}

TEST(FieldCurves, TheSpanWithinThirtyDegreesIsAFifthOfAMillimetre) {
  const System system = navarro_with_condensing_lens(true);
  auto curve = field_curves(PupilTracer(system, Pupil::of_stop(system)), field(), disc_samples());
  curve.pop_back();  // 35 degrees
  EXPECT_NEAR(field_curvature_span(curve), 0.21 * kMm,
              0.005 * kMm);                       // as printed, to its last digit
  EXPECT_NEAR(curve[0].rms, 7 * kUm, 0.5 * kUm);  // facts 3, likewise
  EXPECT_NEAR(curve[4].rms, 47 * kUm, 0.5 * kUm);
}

TEST(FieldCurves, BestFocusOnTheAxisIsThatOfTheFacts) {
  const System system = navarro_with_condensing_lens(true);
  const PupilTracer tracer(system, Pupil::of_stop(system));
  const double row_mm[] = {8.091,  8.574,  9.114,  9.722,  10.413, 11.204,
                           12.118, 13.187, 14.455, 15.983, 17.860};
  Spot spot;
  for (int d = 0; d <= 10; ++d) {
    ASSERT_TRUE(tracer.trace({0, 0, d * kMm}, disc_samples(), spot));
    EXPECT_NEAR(spot.moments().best_focus(), row_mm[d] * kMm, 0.7 * kUm)
        << d;  // printed to 1 um, and rounding
  }
}

TEST(FieldCurves, OnTheAxisTangentialAndSagittalAgreeAndNearItTheyPart) {
  const System system = navarro_with_condensing_lens(true);
  const auto curve =
      field_curves(PupilTracer(system, Pupil::of_stop(system)), field(), disc_samples());
  EXPECT_NEAR(curve[0].tangential, curve[0].sagittal, 1e-12);  // symmetry; rounding of sums
  EXPECT_EQ(curve[0].distortion, 0);
  for (std::size_t i = 1; i < curve.size(); ++i) {
    EXPECT_GT(curve[i].tangential, curve[i].best_focus);
    EXPECT_LT(curve[i].sagittal, curve[i].best_focus);
    EXPECT_LT(curve[i].chief_height, curve[i - 1].chief_height);  // inverted, and growing
    EXPECT_GT(curve[i].distortion, curve[i - 1].distortion);      // pincushion
  }
}

TEST(FieldCurves, ANarrowLensVignettes) {
  System system = navarro_with_condensing_lens(true);
  system.surfaces[5].semi_diameter =
      5 * kMm;  // facts 3: the chief ray at 35 degrees passes at 6.1 mm
  const auto curve = field_curves(PupilTracer(system, Pupil::of_stop(system)),
                                  {0, 25 * kDegree, 40 * kDegree}, disc_samples());
  EXPECT_EQ(curve[0].transmitted, 1);
  EXPECT_GT(curve[1].transmitted, 0);
  EXPECT_LT(curve[1].transmitted, 1);
  EXPECT_EQ(curve[2].transmitted, 0);
}

TEST(Aiming, RaysPassWhereTheyWereAimedInTheRealStop) {
  const System system = navarro_with_condensing_lens(true);
  const PupilTracer tracer(system, Pupil::of_stop(system, Pupil::Kind::real_stop));
  System up_to_stop = system;
  up_to_stop.surfaces.resize(3);
  for (const double degrees : {0.0, 15.0, 35.0}) {
    const Eigen::Vector3d object = *point_at_field(system, degrees * kDegree, 2 * kMm);
    for (const Eigen::Vector2d& sample :
         {Eigen::Vector2d(0, 0), Eigen::Vector2d(0.99, 0), Eigen::Vector2d(-0.6, 0.7)}) {
      const auto ray = tracer.aim(object, sample);
      ASSERT_TRUE(ray);
      EXPECT_EQ(ray->origin, object);
      const TraceResult behind =
          trace_out(up_to_stop, *ray);  // the sag is negative: the plane lies behind the surface
      ASSERT_EQ(behind.status, TraceStatus::ok);
      const double left = system.vertex(3) - behind.ray.origin.z();
      const Eigen::Vector3d in_stop =
          behind.ray.origin + behind.ray.direction * (left / behind.ray.direction.z());
      EXPECT_LT((in_stop.head<2>() - sample * 1.5 * kMm).norm(),
                1e-12);  // m: what the aiming asks of itself
    }
  }
}

TEST(Aiming, BothReadingsOfTheStopHaveTheSameChiefRay) {
  const System system = navarro_with_condensing_lens(true);
  const Eigen::Vector3d object = *point_at_field(system, 30 * kDegree);
  const auto a = PupilTracer(system, Pupil::of_stop(system)).aim(object);
  const auto b = PupilTracer(system, Pupil::of_stop(system, Pupil::Kind::real_stop)).aim(object);
  ASSERT_TRUE(a && b);
  EXPECT_LT((a->direction - b->direction).norm(), 1e-10);
}

TEST(Aiming, AMicroscopesChiefRayIsItsIsopixelLine) {
  const System system = model_eye_5_3();
  Microscope microscope;
  microscope.pupil_distance = 0.15;
  microscope.decenter = {0.3 * kMm, -0.2 * kMm};
  microscope.tilt = {0.01, 0.02};
  const Eigen::Vector2d m(2 * kMm, -1 * kMm);
  const Ray line = *isopixel_line(system, microscope, m);
  const Eigen::Vector3d point =
      line.origin - line.direction * ((line.origin.z() - 5 * kMm) / line.direction.z());
  const auto ray = PupilTracer(system, Pupil::of_microscope(system, microscope)).aim(point);
  ASSERT_TRUE(ray);
  EXPECT_LT((ray->direction - line.direction).norm(),
            1e-9);  // 1e-13 m in the pupil, seen from 10 mm
}

TEST(Aiming, PointsOutsideTheVitreousHaveNoRay) {
  const System system = navarro_with_condensing_lens(true);
  const PupilTracer tracer(system, Pupil::of_stop(system));
  Spot spot;
  for (const Eigen::Vector3d& point :
       {Eigen::Vector3d(0, 0, -1 * kMm), Eigen::Vector3d(5 * kMm, 0, 0.5 * kMm),
        Eigen::Vector3d(0, 0, 17 * kMm), Eigen::Vector3d(kNan, 0, 5 * kMm),
        Eigen::Vector3d(0, 40 * kMm, 5 * kMm)}) {
    EXPECT_FALSE(tracer.aim(point)) << point.transpose();
    EXPECT_FALSE(tracer.trace(point, disc_samples(), spot));
    EXPECT_EQ(spot.rays(), 0);
  }
}

TEST(Aiming, RefusesBadArguments) {
  System system = navarro_with_condensing_lens(true);
  expect_refused("rings", [] { disc_samples(0, 4); });
  expect_refused("count", [] { fan_samples(1); });
  expect_refused("angle", [&] { point_at_field(system, kNan); });
  expect_refused("depth", [&] { point_at_field(system, 0, kNan); });
  EXPECT_FALSE(point_at_field(system, 0, 30 * kMm));   // beyond the stop
  EXPECT_FALSE(point_at_field(system, 75 * kDegree));  // past the edge of the retina's half sphere
  system.stop.reset();
  expect_refused("stop", [&] { Pupil::of_stop(system); });
}

TEST(Spot, ModulationTransferOfADiscIsThatOfTheFormula) {
  Spot spot;  // a uniformly filled disc of 10 um: 2 J1(x) / x with x = 2 pi f R
  for (const Eigen::Vector2d& p : disc_samples(60, 120)) {
    spot.position.push_back(p * 10 * kUm);
    spot.slope.push_back({0, 0});
  }
  EXPECT_DOUBLE_EQ(geometric_mtf(spot, 0, {0, 0}), 1);
  for (const double frequency : {1e4, 3e4, 6e4}) {
    const double x = 2 * std::numbers::pi * frequency * 10 * kUm;
    EXPECT_NEAR(geometric_mtf(spot, 0, {frequency, 0}), std::abs(2 * std::cyl_bessel_j(1, x) / x),
                2e-3);  // 60 rings
  }
}

TEST(Spot, PointSpreadHoldsAllRaysAndTheWidthIsLeastAtBestFocus) {
  const System system = navarro_with_condensing_lens(true);
  Spot spot;
  ASSERT_TRUE(PupilTracer(system, Pupil::of_stop(system))
                  .trace(*point_at_field(system, 20 * kDegree), disc_samples(), spot));
  const SpotMoments moments = spot.moments();
  const double focus = moments.best_focus();
  EXPECT_NEAR(geometric_psf(spot, focus, 1 * kMm, 64).sum(), 1, 1e-12);
  EXPECT_LT(moments.rms(focus), moments.rms(focus + 1 * kUm));
  EXPECT_LT(moments.rms(focus), moments.rms(focus - 1 * kUm));
  double square = 0;
  for (const Eigen::Vector2d& p : spot.at(focus))
    square += (p - moments.mean_at(focus)).squaredNorm();
  EXPECT_NEAR(moments.rms(focus), std::sqrt(square / spot.rays()), 1e-12);
  expect_refused("cells", [&] { geometric_psf(spot, focus, 1 * kMm, 0); });
  expect_refused("half_width", [&] { geometric_psf(spot, focus, kNan, 4); });
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
