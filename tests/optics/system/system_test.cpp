// SPDX-License-Identifier: Apache-2.0
#include "optics/system/system.h"

#include "tests/optics/support.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
// Lengths of millimeters in m are rounded at 1e-18; a few operations later they still agree to
// this.
constexpr double kRounding = 1e-16;

TEST(System, SagOfASphereIsThatOfACircle) {
  const Surface sphere = make_surface(-9.48 * kMm, 0, 0, 1);
  for (double r : {0.0, 1e-6, 1e-3, 5e-3, 9.4e-3}) {
    const double R = 9.48 * kMm;
    EXPECT_NEAR(sphere.sag(r), -(R - std::sqrt(R * R - r * r)), 1e-17 + kRounding) << r;
  }
}

TEST(System, SagOfAParaboloidIsItsOneTerm) {
  const Surface paraboloid = make_surface(6 * kMm, -1, 0, 1);
  EXPECT_NEAR(paraboloid.sag(30 * kMm), 30 * kMm * 30 * kMm / (12 * kMm), kRounding);
}

TEST(System, SagOfAPlaneIsZeroAndOfAPureAsphereItsPolynomial) {
  Surface plane;
  EXPECT_EQ(plane.sag(5 * kMm), 0);
  plane.aspheric = {1e3, 2e6, 0, 3e12};
  const double r = 4 * kMm;
  EXPECT_NEAR(plane.sag(r), 1e3 * std::pow(r, 4) + 2e6 * std::pow(r, 6) + 3e12 * std::pow(r, 10),
              kRounding);
}

TEST(System, SagIsNotANumberWhereTheSurfaceDoesNotReach) {
  EXPECT_TRUE(std::isnan(make_surface(10 * kMm, 0, 0, 1).sag(10.1 * kMm)));
  EXPECT_FALSE(std::isnan(make_surface(10 * kMm, -2, 0, 1).sag(100 * kMm)));
}

TEST(System, ModelEyeHasTheVerticesAndTheStopOfTable53) {
  const System eye = model_eye_5_3();
  EXPECT_NO_THROW(eye.check());
  EXPECT_EQ(eye.size(), 7);
  EXPECT_EQ(eye.vertex(1), 0);
  EXPECT_NEAR(eye.vertex(2), 15.50 * kMm, kRounding);
  EXPECT_NEAR(eye.vertex(7), 40.99 * kMm, kRounding);
  EXPECT_LT(eye.surfaces[4].radius, 0);
  ASSERT_TRUE(eye.stop);
  EXPECT_EQ(eye.stop->surface, 3);
  EXPECT_NEAR(eye.stop->radius, 1.5 * kMm, kRounding);
}

TEST(System, VertexOfASurfaceThatIsNotThereIsRefused) {
  const System eye = model_eye_5_3();
  expect_refused("surface", [&] { (void)eye.vertex(0); });
  expect_refused("surface", [&] { (void)eye.vertex(8); });
}

TEST(System, CheckNamesTheSurfaceAndTheParameter) {
  const auto refused = [](const std::string& name, auto spoil) {
    System eye = model_eye_5_3();
    spoil(eye);
    expect_refused(name, [&] { eye.check(); });
  };
  refused("surface 3: radius", [](System& eye) { eye.surfaces[2].radius = 0; });
  refused("surface 3: radius", [](System& eye) { eye.surfaces[2].radius = kNan; });
  refused("surface 4: conic", [](System& eye) { eye.surfaces[3].conic = kNan; });
  refused("surface 6: aspheric", [](System& eye) { eye.surfaces[5].aspheric[1] = kNan; });
  refused("surface 2: thickness", [](System& eye) { eye.surfaces[1].thickness = -1e-3; });
  refused("surface 2: thickness",
          [](System& eye) { eye.surfaces[1].thickness = std::numeric_limits<double>::infinity(); });
  refused("surface 1: index", [](System& eye) { eye.surfaces[0].index = 0.99; });
  refused("surface 5: index", [](System& eye) { eye.surfaces[4].index = kNan; });
  refused("surface 5: semi_diameter", [](System& eye) { eye.surfaces[4].semi_diameter = 0; });
  refused("stop: surface 1", [](System& eye) { eye.stop = Stop{1, 1e-3}; });
  refused("stop: surface 8", [](System& eye) { eye.stop = Stop{8, 1e-3}; });
  refused("surface 3: stop radius", [](System& eye) { eye.stop->radius = -1; });
  refused("surfaces", [](System& eye) { eye.surfaces.resize(1); });
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
