// Numerical aperture, depths and fields of view: the thesis' numbers and the consistent ones.
// SPDX-License-Identifier: Apache-2.0
#include "optics/analysis/viewing.h"

#include "optics/system/prescriptions.h"
#include "tests/optics/support.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

constexpr double kDegree = std::numbers::pi / 180;

TEST(Viewing, NumericalApertureByOslosRuleIsThatOfTheThesis) {
  const NumericalAperture aperture = numerical_aperture(prescription("navarro_condensing").system);
  EXPECT_NEAR(aperture.oslo, 0.158998, 0.5e-6);
  EXPECT_NEAR(aperture.object_beam, 0.122279, 0.5e-6);
  // The others to the digits that the facts print.
  EXPECT_NEAR(aperture.image_beam, 0.1559, 0.5e-4);
  EXPECT_NEAR(aperture.image_stop, 0.1336, 0.5e-4);
}

TEST(Viewing, DepthOfFocusIsTheThesis95MicrometersAndTheConsistentOnesBesideIt) {
  const DepthOfFocus depth = depth_of_focus(prescription("navarro_condensing").system, 6.4 * kUm);
  EXPECT_NEAR(depth.thesis, 95.13 * kUm, 0.005 * kUm);  // 94.65 with the thesis' m = 0.76
  EXPECT_NEAR(depth.image_side, 95.13 / 1.336 * kUm, 0.01 * kUm);
  EXPECT_NEAR(depth.object_side, 123.7 * kUm, 0.1 * kUm);
}

TEST(Viewing, DepthOfFocusOfTheModelEyeOfChapter4Is83Micrometers) {
  EXPECT_NEAR(depth_of_focus(prescription("model_eye_in_air").system, 9.9 * kUm).thesis, 83 * kUm,
              0.5 * kUm);
}

TEST(Viewing, DepthOfFieldIsAbout150MicrometersBySecantAnd214AtTheRetina) {
  const DepthOfField depth = depth_of_field(prescription("navarro_condensing").system, 6.4 * kUm);
  EXPECT_NEAR(depth.thesis, 157 * kUm, 1.5 * kUm);  // the facts take m = 0.76: half a per cent less
  EXPECT_NEAR(depth.at_retina, 214 * kUm, 1.5 * kUm);  // likewise
  EXPECT_NEAR(depth.consistent, depth.at_retina / 1.336, 1e-12);
}

TEST(Viewing, TheChiefRayAt35DegreesHasTheHeightsOfTheFacts) {
  const System eye = prescription("navarro_condensing").system;
  // Search the angle in the lens that belongs to a field of 35 degrees.
  double low = 0, high = 60 * kDegree;
  for (int i = 0; i < 60; ++i) {
    const double middle = (low + high) / 2;
    (chief_ray_at_stop(eye, middle).field_angle < 35 * kDegree ? low : high) = middle;
  }
  const ChiefRay ray = chief_ray_at_stop(eye, low);
  ASSERT_TRUE(ray.complete);
  ASSERT_EQ(ray.heights.size(), 7u);
  EXPECT_NEAR(ray.field_angle, 35 * kDegree, 1e-9);
  EXPECT_LT(ray.heights[0], 0);
  EXPECT_NEAR(ray.heights[2], 0, 1e-12);
  EXPECT_NEAR(ray.heights[5], 6.1 * kMm, 0.05 * kMm);
  EXPECT_NEAR(ray.heights[6], 8.6 * kMm, 0.05 * kMm);
}

TEST(Viewing, FieldsOfViewAreThoseOfSection31) {
  const FieldAssumptions assumed;
  const FieldOfView direct =
      direct_field_of_view(prescription("navarro").system, assumed.observer_distance);
  EXPECT_NEAR(direct.angle / kDegree, 10, 1.5);  // "~10"
  const FieldOfView contact =
      vignetted_field_of_view(prescription("navarro_vitrectomy").system, 5, assumed.contact_radius);
  EXPECT_NEAR(contact.angle / kDegree, 40, 1);  // "up to 40"
  const FieldOfView indirect = vignetted_field_of_view(prescription("navarro_condensing").system, 5,
                                                       assumed.condensing_radius);
  EXPECT_GE(indirect.angle / kDegree, 70);  // 70 to 100
  EXPECT_LE(indirect.angle / kDegree, 100);
}

TEST(Viewing, AWiderLensNeverShowsLess) {
  const System eye = prescription("navarro_condensing_conic").system;
  double before = 0;
  for (double radius : {2e-3, 4e-3, 6e-3, 8e-3, 10e-3}) {
    const double angle = vignetted_field_of_view(eye, 5, radius).angle;
    EXPECT_GT(angle, before) << radius;
    before = angle;
  }
}

TEST(Viewing, RefusesWhatItCannotAnswer) {
  System eye = prescription("navarro").system;
  expect_refused("confusion", [&] { (void)depth_of_focus(eye, -1); });
  expect_refused("angle", [&] { (void)chief_ray_at_stop(eye, 2); });
  expect_refused("observer_distance", [&] { (void)direct_field_of_view(eye, std::nan("")); });
  expect_refused("clear_radius", [&] { (void)vignetted_field_of_view(eye, 4, 0); });
  expect_refused("from_surface", [&] { (void)vignetted_field_of_view(eye, 9, 1e-3); });
  eye.stop.reset();
  expect_refused("stop", [&] { (void)numerical_aperture(eye); });
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
