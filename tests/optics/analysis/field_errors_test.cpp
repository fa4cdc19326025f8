// Errors of uncertain eyes over the field: figures 4.2, 4.5, 4.6 and table 5.2, the thesis' numbers
// beside ours.
// SPDX-License-Identifier: Apache-2.0
#include "optics/analysis/field_errors.h"

#include "optics/maps/thesis_curves.h"
#include "tests/optics/support.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <set>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

constexpr double kDegree = std::numbers::pi / 180;
const Prescription kEye = prescription("navarro_condensing");

FieldErrorOptions within_30_degrees() {
  FieldErrorOptions options;
  options.max_angle = 30 * kDegree;
  return options;
}

TEST(FieldErrors, TheFiveWorstOfFigure42AreThoseOfTheThesis) {
  const auto ranking = one_at_a_time(kEye, table_5_1(), field_error(kEye, within_30_degrees()));
  std::set<std::string> worst;
  for (int i = 0; i < 5; ++i) worst.insert(ranking[i].parameter);
  EXPECT_EQ(worst, (std::set<std::string>{"lens.index", "vitreous.index", "aqueous.index",
                                          "cornea.anterior.radius", "cornea.index"}));
  EXPECT_EQ(ranking[0].parameter, "lens.index");
  const double to_35 = field_error(kEye)(perturbed(kEye, {"lens.index", 0.04, ""}, 1)).value();
  std::cout << "figure 4.2: lens.index " << to_35 / kMm
            << " mm; thesis about 4.5 and up to 4, facts 3.7\n";
  EXPECT_NEAR(to_35, 3.7 * kMm, 0.3 * kMm);
}

TEST(FieldErrors, TheBelievedEyeLeavesTheFitsOwnErrorAndASensorOutOfPlaceAddsToIt) {
  FieldErrorOptions options;
  EXPECT_NEAR(field_error(kEye, options)(kEye).value(), 0.58 * kMm,
              0.1 * kMm);  // facts 3, at the corner
  options.measure = ErrorMeasure::mean;
  options.focus_error = 0.1 * kMm;
  EXPECT_NEAR(field_error(kEye, options)(kEye).value(), 0.15 * kMm,
              0.03 * kMm);  // facts 4; figure 4.2e
  options.focus_error = 0.3 * kMm;
  EXPECT_NEAR(field_error(kEye, options)(kEye).value(), 0.38 * kMm, 0.03 * kMm);
}

TEST(FieldErrors, CalibrationOnTheRetinaTakesMostOfItAwayAndAWrongRetinaGivesSomeBack) {
  FieldErrorOptions options = within_30_degrees();
  options.measure = ErrorMeasure::mean;
  const EyeError before = field_error(kEye, options);
  options.calibrated = true;
  const EyeError after = field_error(kEye, options);
  options.retinal_depth_error = 0.3 * kMm;
  const EyeError with_error = field_error(kEye, options);
  for (const double sigmas : {-1.0, 1.0}) {
    const Prescription truth = perturbed(kEye, {"lens.index", 0.03, ""}, sigmas);  // figure 4.5
    EXPECT_LT(after(truth).value(), 0.3 * before(truth).value());
    EXPECT_GT(with_error(truth).value(), after(truth).value() + 0.05 * kMm);
    EXPECT_LT(with_error(truth).value(), 0.5 * before(truth).value());
  }
}

// In this eye the sensor's and the retina's errors are worst with opposite signs: 0.65 mm at the
// field's worst point, and 0.53 mm with equal ones.
TEST(FieldErrors, TheSignsOfTheSensorsAndOfTheRetinasErrorAreIndependent) {
  const Prescription eye = prescription("model_eye_5_3");
  FieldErrorOptions options;
  options.max_angle = 15 * kDegree;
  options.angles = options.depths = 6;
  options.rings = 3, options.arms = 8;
  options.calibrated = true;
  options.focus_error = 0.1 * kMm;
  options.retinal_depth_error = 0.3 * kMm;
  const Prescription truth = perturbed(eye, {"lens.anterior.radius", 0.04, ""}, 1);
  EXPECT_NEAR(field_error(eye, options)(truth).value(), 0.65 * kMm, 0.03 * kMm);
}

struct Row {
  const char* parameter;
  double thesis;  // um, mu_max of table 5.2, its rows put right as facts 5 has them
};
constexpr Row kTable52[] = {
    {"lens.index", 616},
    {"aqueous.thickness", 481},
    {"lens.thickness", 466},
    {"aqueous.index", 422},
    {"vitreous.index", 364},
    {"cornea.anterior.radius", 361},
    {"cornea.thickness", 295},
    {"cornea.index", 283},
    {"lens.posterior.radius", 282},
    {"cornea.posterior.radius", 272},
    {"lens.anterior.radius", 266},
};

TEST(FieldErrors, Table52IsThePureEffectOfTheParametersOnAConstantFloor) {
  const auto ranking = one_at_a_time(kEye, table_5_1(), pose_error(kEye));
  EXPECT_LT(pose_error(kEye)(kEye).value(), 1e-9);
  for (const Row& row : kTable52) {
    const auto ours = std::find_if(ranking.begin(), ranking.end(),
                                   [&](const auto& one) { return one.parameter == row.parameter; });
    ASSERT_NE(ours, ranking.end());
    const double law =
        254 + 1.07 * ours->worst() / kUm;  // facts 5; the floor's origin is not known
    std::cout << "table 5.2: " << row.parameter << " ours " << ours->worst() / kUm
              << " um, 254 + 1.07 ours " << law << ", thesis " << row.thesis << "\n";
    EXPECT_NEAR(law, row.thesis, 40) << row.parameter;
  }
}

TEST(FieldErrors, OneLookAtTheRetinaMendsThePoseWhicheverTheProjection) {
  PoseErrorOptions options;
  options.angles = options.depths = 4;
  for (const bool exact : {false, true}) {
    options.exact = exact;
    options.calibrated = false, options.retinal_depth_error = 0;
    const EyeError before = pose_error(kEye, options);
    options.calibrated = true;
    const EyeError after = pose_error(kEye, options);
    options.retinal_depth_error = 0.3 * kMm;
    const EyeError with_error = pose_error(kEye, options);
    const Prescription truth = perturbed(kEye, {"lens.index", 0.04, ""}, 1);
    EXPECT_LT(after(truth).value(), 0.6 * before(truth).value());
    EXPECT_GT(with_error(truth).value(), 0.2 * kMm);
  }
}

TEST(FieldErrors, TheyPlugIntoStatisticsAndIntoWhatToMeasure) {
  std::mt19937_64 random(5);
  const auto eyes = monte_carlo(kEye, table_5_1(), 20, random);
  FieldErrorOptions options = within_30_degrees();
  options.angles = 4, options.depths = 4, options.rings = 3, options.arms = 8;
  options.measure = ErrorMeasure::mean;
  const ErrorStatistics before = statistics(eyes, field_error(kEye, options));
  options.calibrated = true;
  const ErrorStatistics after = statistics(eyes, field_error(kEye, options));
  EXPECT_GE(before.count, 17);
  EXPECT_LT(after.median, 0.5 * before.median);
  PoseErrorOptions pose;
  pose.angles = pose.depths = 3;
  const auto make = [&](const Prescription& believed) { return pose_error(believed, pose); };
  const std::vector<Uncertainty> two{{"lens.index", 0.04, ""}, {"lens.anterior.radius", 0.04, ""}};
  const auto list = variance_attribution(kEye, two, make, 5, random);
  ASSERT_EQ(list.size(), 2u);
  EXPECT_EQ(list[0].parameter, "lens.index");
  EXPECT_GT(list[0].reduction, 0.8);
}

// The isofocus surfaces of table 5.3 flatten with depth until they bend the other way: the crossing
// near the pole counts there too, not the one on the far side of the sphere, tens of millimeters
// away.
TEST(FieldErrors, SurfacesThatBendTheOtherWayAreCrossedNearTheirPole) {
  const Prescription eye = prescription("model_eye_5_3");
  FieldErrorOptions options;
  options.max_angle = 15 * kDegree;
  const EyeError error = field_error(eye, options);
  EXPECT_LT(error(eye).value(), 0.2 * kMm);
  for (const Uncertainty& one : applicable(table_5_1(), eye)) {
    for (const double sigmas : {-1.0, 1.0}) {
      const auto off = error(perturbed(eye, one, sigmas));
      ASSERT_TRUE(off.has_value()) << one.parameter;
      EXPECT_LT(*off, 3 * kMm)
          << one.parameter;  // the refraction that all of them change by a sigma is worth 2.3 mm
    }
  }
  ThesisCurves bent;
  bent.radius.c = {-50 * kMm, 0, 0, 0}, bent.pole.c = {5 * kMm, 0, 0, 0};
  bent.intercept.c = {2 * kMm, 0, 0, 0}, bent.slope.c = {-0.1, 0, 0, 0};
  const auto crossing = bent.extrapolated_point(10 * kMm, 1 * kMm);
  ASSERT_TRUE(crossing.has_value());
  EXPECT_NEAR(crossing->z, 5 * kMm - crossing->r * crossing->r / (2 * 50 * kMm),
              1e-7);  // the sphere's sag
  EXPECT_NEAR(crossing->r, 2 * kMm - 0.1 * crossing->z, 1e-12);
}

TEST(FieldErrors, AnEyeThatShowsTooLittleHasNoAnswer) {
  Prescription narrow = kEye;
  narrow.system.surfaces[6].semi_diameter = 3 * kMm;  // clips the bundles beyond 15 degrees
  EXPECT_FALSE(field_error(kEye)(narrow));
  Prescription blind = kEye;
  blind.system.stop.reset();
  expect_refused("stop", [&] { (void)field_error(blind); });
  expect_refused("stop", [&] { (void)pose_error(blind); });
}

TEST(FieldErrors, BadOptionsAreRefusedByName) {
  const double nan = std::nan("");
  const auto field = [](const char* name, auto spoil) {
    FieldErrorOptions options;
    spoil(options);
    expect_refused(name, [&] { (void)field_error(kEye, options); });
  };
  field("max_angle", [&](auto& o) { o.max_angle = nan; });
  field("depth_to", [](auto& o) { o.depth_to = 0; });
  field("angles", [](auto& o) { o.angles = 2; });
  field("depths", [](auto& o) { o.depths = 2; });
  field("rings", [](auto& o) { o.rings = 0; });
  field("arms", [](auto& o) { o.arms = 1; });
  field("focus_error", [](auto& o) { o.focus_error = -1; });
  field("retinal_depth_error", [&](auto& o) { o.retinal_depth_error = nan; });
  const auto pose = [](const char* name, auto spoil) {
    PoseErrorOptions options;
    spoil(options);
    expect_refused(name, [&] { (void)pose_error(kEye, options); });
  };
  pose("max_m", [&](auto& o) { o.max_m = nan; });
  pose("max_angle", [](auto& o) { o.max_angle = 2; });
  pose("depth_to", [](auto& o) { o.depth_to = o.depth_from; });
  pose("angles", [](auto& o) { o.angles = 2; });
  pose("depths", [](auto& o) { o.depths = 2; });
  pose("retinal_depth_error", [](auto& o) { o.retinal_depth_error = 2e-3; });
  pose("numerical_aperture", [](auto& o) { o.microscope.numerical_aperture = 0; });
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
