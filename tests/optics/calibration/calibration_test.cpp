// On-axis calibration: the mended signs, the refinement, one known retina, and what cannot be
// calibrated.
// SPDX-License-Identifier: Apache-2.0
#include "optics/calibration/calibration.h"

#include "optics/rays/pupil.h"
#include "optics/system/first_order.h"
#include "optics/system/prescriptions.h"
#include "tests/optics/support.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
const double kVitreous = 16.32 * kMm;

Prescription with_lens_index(double factor) {
  const Prescription eye = prescription("navarro_condensing");
  const std::array<Override, 1> change{{{"lens.index", parameter(eye, "lens.index") * factor}}};
  return with_parameters(eye, change);
}

TEST(Calibration, TheLawSeesTheRetinaAtMinus1632AndIsItsOwnInverse) {
  const OnAxisLaw law = on_axis_law(prescription("navarro_condensing").system);
  const auto retina = law.object_from_sensor(7.85687 * kMm);
  ASSERT_TRUE(retina);
  EXPECT_NEAR(*retina, -16.3200 * kMm, 0.5e-4 * kMm);
  for (double d : {0.0, 3e-3, 8e-3}) {
    const auto sensor = law.sensor_from_object(d - kVitreous);
    ASSERT_TRUE(sensor);
    EXPECT_NEAR(*sensor, axial_image(prescription("navarro_condensing").system, d)->distance, 1e-14)
        << d;
    EXPECT_NEAR(*law.object_from_sensor(*sensor), d - kVitreous, 1e-14) << d;
  }
}

TEST(Calibration, RefinedToTheBestFocusCurveTheLawIsNearlyExact) {
  // Row "3.4 best focus" of facts section 2, printed to 1 um; a um of sensor is up to 2.3 um of
  // depth.
  const std::array<double, 9> best_mm{8.091,  8.574,  9.114,  9.722, 10.413,
                                      11.204, 12.118, 13.187, 14.455};
  std::vector<OnAxisPoint> points;
  for (int d = 0; d <= 8; ++d) points.push_back({best_mm[d] * kMm, d * kMm - kVitreous});
  const OnAxisLaw start = on_axis_law(prescription("navarro_condensing").system);
  double before = 0;
  for (const auto& point : points)
    before = std::max(before, std::abs(*start.object_from_sensor(point.sensor) - point.object));
  EXPECT_NEAR(before, 0.51 * kMm, 0.02 * kMm);
  const OnAxisFit fit = fit_on_axis(start, points);
  EXPECT_LT(fit.max_residual, 1.5 * kUm);  // the rounding of the row; without it 0.14 um
  EXPECT_NEAR(fit.law.focal_length, 10.990 * kMm,
              0.03 * kMm);  // what that rounding lets f, PP1, PP2 play against each
  EXPECT_NEAR(fit.law.first_principal_point, 17.157 * kMm, 0.04 * kMm);  // other
  EXPECT_NEAR(fit.law.second_principal_point, -11.485 * kMm, 0.04 * kMm);
  EXPECT_GT(fit.covariance(0, 0), 0);
}

std::optional<double> traced_focus(const PupilTracer& pupil, double depth) {
  Spot spot;
  if (!pupil.trace({0, 0, depth}, disc_samples(), spot)) return std::nullopt;
  return spot.moments().best_focus();
}

TEST(Calibration, RefinedToTracedBestFocusTheLawIsGoodToAFractionOfAMicrometre) {
  const System eye = prescription("navarro_condensing").system;
  const PupilTracer pupil(eye, Pupil::of_stop(eye));
  std::vector<OnAxisPoint> points;
  for (int i = 0; i <= 40; ++i) {
    const auto focus = traced_focus(pupil, i * 0.2 * kMm);
    ASSERT_TRUE(focus);
    points.push_back({*focus, i * 0.2 * kMm - kVitreous});
  }
  const OnAxisFit fit = fit_on_axis(on_axis_law(eye), points);
  EXPECT_LT(fit.max_residual, 0.3 * kUm);  // facts: 0.14 um, with another grid of depths
  EXPECT_NEAR(fit.law.focal_length, 10.990 * kMm,
              0.002 * kMm);  // three decimals there, and the grid again
  EXPECT_NEAR(fit.law.first_principal_point, 17.157 * kMm, 0.003 * kMm);
  EXPECT_NEAR(fit.law.second_principal_point, -11.485 * kMm, 0.003 * kMm);
}

TEST(Calibration, TracedBestFocusOfThreePerCentOfTheLensIndexIsCalibratedAsFigure45) {
  const System known = prescription("navarro_condensing").system;
  const PupilTracer believed_pupil(known, Pupil::of_stop(known));
  std::vector<OnAxisPoint> points;
  for (int i = 0; i <= 8; ++i)
    points.push_back({traced_focus(believed_pupil, i * kMm).value(), i * kMm - kVitreous});
  const OnAxisLaw believed = fit_on_axis(on_axis_law(known), points).law;
  for (double factor : {0.97, 1.03}) {
    const System truth = with_lens_index(factor).system;
    const PupilTracer pupil(truth, Pupil::of_stop(truth));
    const OnAxisPoint retina{traced_focus(pupil, 0).value(), -kVitreous};
    const OnAxisLaw shift = calibrate_biometric(believed, retina).law;
    const OnAxisLaw norm = calibrate_biometric(believed, retina, BiometricMethod::minimum_norm).law;
    double worst_shift = 0, worst_norm = 0;
    for (int i = 0; i <= 8; ++i) {
      const double sensor = traced_focus(pupil, i * kMm).value(), object = i * kMm - kVitreous;
      worst_shift =
          std::max(worst_shift, std::abs(shift.object_from_sensor(sensor).value() - object));
      worst_norm = std::max(worst_norm, std::abs(norm.object_from_sensor(sensor).value() - object));
    }
    EXPECT_LE(worst_shift, 0.125 * kMm) << factor;  // facts section 4: <= 0.12
    EXPECT_LE(worst_norm, 0.485 * kMm) << factor;   // and <= 0.48
  }
}

TEST(Calibration, BiometricCalibrationTakesMostOfThreePerCentOfTheLensIndexAway) {
  const OnAxisLaw believed = on_axis_law(prescription("navarro_condensing").system);
  for (double factor : {0.97, 1.03}) {
    const System truth = with_lens_index(factor).system;
    const OnAxisPoint retina{axial_image(truth, 0)->distance, -kVitreous};
    const auto shift = calibrate_biometric(believed, retina);
    const auto norm = calibrate_biometric(believed, retina, BiometricMethod::minimum_norm);
    double before = 0, worst_shift = 0, worst_norm = 0;
    for (double d = 0; d <= 8e-3; d += 0.5e-3) {
      const double sensor = axial_image(truth, d)->distance, object = d - kVitreous;
      before = std::max(before, std::abs(*believed.object_from_sensor(sensor) - object));
      worst_shift = std::max(worst_shift, std::abs(*shift.law.object_from_sensor(sensor) - object));
      worst_norm = std::max(worst_norm, std::abs(*norm.law.object_from_sensor(sensor) - object));
    }
    EXPECT_GT(before, 2 * kMm) << factor;  // 2.2 and 3.0 in figure 4.5
    // Facts section 4: 0.12 and 0.48 mm with the traced best focus; the paraxial law here differs
    // by a few hundredths.
    EXPECT_LE(worst_shift, 0.15 * kMm) << factor;
    EXPECT_LE(worst_norm, 0.55 * kMm) << factor;
    EXPECT_LT(worst_shift, worst_norm);
    EXPECT_LT(shift.residual, 1e-14);
    EXPECT_LT(norm.residual, 1e-12);
    EXPECT_EQ(shift.law.object_shift, 0);
    EXPECT_LT(std::hypot(norm.law.sensor_shift, norm.law.object_shift),
              std::abs(shift.law.sensor_shift));
  }
}

TEST(Calibration, MinimumNormIsSmallerThanItsNeighborsOnTheConstraint) {
  const OnAxisLaw believed = on_axis_law(prescription("navarro_condensing").system);
  const OnAxisPoint retina{9 * kMm, -kVitreous};
  const OnAxisLaw best = calibrate_biometric(believed, retina, BiometricMethod::minimum_norm).law;
  const double least = std::hypot(best.sensor_shift, best.object_shift);
  for (double by : {-1e-4, -1e-5, 1e-5, 1e-4}) {
    OnAxisLaw other = best;
    other.sensor_shift += by;
    other.object_shift += retina.object - *other.object_from_sensor(retina.sensor);
    EXPECT_GT(std::hypot(other.sensor_shift, other.object_shift), least) << by;
  }
}

TEST(Calibration, DegeneratePointsAreRefused) {
  const OnAxisLaw law = on_axis_law(prescription("navarro_condensing").system);
  const auto refused = [&](const std::vector<OnAxisPoint>& points) {
    expect_refused("points", [&] { (void)fit_on_axis(law, points); });
  };
  refused({});
  refused({{8e-3, -16e-3}, {9e-3, -15e-3}});
  refused({{8e-3, -16e-3}, {9e-3, -15e-3}, {9e-3, -15e-3}});
  refused({{8e-3, -16e-3}, {9e-3, -15e-3}, {kNan, -14e-3}});
  expect_refused("retina", [&] { (void)calibrate_biometric(law, {kNan, -16e-3}); });
  expect_refused("retina", [&] {
    const double pole =
        law.first_principal_point - law.focal_length * law.object_index;  // imaged at infinity
    (void)calibrate_biometric(law, {8e-3, pole});
  });
  OnAxisLaw bad = law;
  bad.focal_length = 0;
  expect_refused("focal_length", [&] { (void)calibrate_biometric(bad, {8e-3, -16e-3}); });
  bad = law;
  bad.sensor_shift = kNan;
  expect_refused("sensor_shift", [&] { (void)calibrate_biometric(bad, {8e-3, -16e-3}); });
}

TEST(Calibration, AtItsPoleTheLawAnswersNothing) {
  const OnAxisLaw law = on_axis_law(prescription("navarro_condensing").system);
  EXPECT_FALSE(law.object_from_sensor(law.focal_length + law.second_principal_point));
  EXPECT_FALSE(law.object_from_sensor(kNan));
  EXPECT_FALSE(law.sensor_from_object(kNan));
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
