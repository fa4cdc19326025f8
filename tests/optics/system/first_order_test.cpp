// First-order data against those of an independent program (facts, section 2), and against traced
// rays near the axis.
// SPDX-License-Identifier: Apache-2.0
#include "optics/system/first_order.h"

#include "optics/rays/trace.h"
#include "optics/system/prescriptions.h"
#include "tests/optics/support.h"

#include <Eigen/LU>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

// Half a unit of the last of five printed decimals, in mm.
constexpr double kPrinted = 0.5e-5 * kMm * 1.0001;

struct Expected {
  const char* name;
  double f, front_f, pp1, pp2, image, image_tolerance, magnification,
      magnification_tolerance;  // mm, 1
};

TEST(FirstOrder, DataOfTheThesisSystemsAgreeToAllPrintedDigits) {
  const std::array<Expected, 5> systems{{
      {"navarro", 16.55815, 22.12168, 5.70769, -1.58529, -3882.1, 0.05, 235, 0.5},
      {"navarro_vitrectomy", 94.23200, 125.894, -5.27943, -10.42533, -19.484, 5e-4, 1.0961, 5e-5},
      {"navarro_condensing_conic", 10.83323, 14.47320, 16.97261, -11.30774, 7.85687, 5e-6, -0.76906,
       5e-6},
      {"navarro_condensing", 10.83323, 14.47320, 16.97261, -11.30774, 7.85687, 5e-6, -0.76906,
       5e-6},
      {"model_eye_5_3", 11.39315, 15.98459, 21.04290, -11.26693, 8.98468, 5e-6, -0.77752, 5e-6},
  }};
  for (const Expected& expected : systems) {
    SCOPED_TRACE(expected.name);
    const System eye = prescription(expected.name).system;
    const auto points = cardinal_points(eye);
    ASSERT_TRUE(points);
    EXPECT_NEAR(points->focal_length, expected.f * kMm, kPrinted);
    const double front_digits = expected.front_f > 100 ? 5e-4 * kMm : kPrinted;
    EXPECT_NEAR(points->front_focal_length, expected.front_f * kMm, front_digits);
    EXPECT_NEAR(points->first_principal_point, expected.pp1 * kMm, kPrinted);
    EXPECT_NEAR(points->second_principal_point, expected.pp2 * kMm, kPrinted);
    const auto image = axial_image(eye, 0);
    ASSERT_TRUE(image);
    EXPECT_NEAR(image->distance, expected.image * kMm, expected.image_tolerance * kMm);
    EXPECT_NEAR(image->magnification, expected.magnification, expected.magnification_tolerance);
  }
}

TEST(FirstOrder, TheMisprintedEyeIsTheNegativeLensOfTheFacts) {
  const System eye = prescription("model_eye_5_3_printed").system;
  const auto points = cardinal_points(eye);
  ASSERT_TRUE(points);
  EXPECT_NEAR(points->focal_length, 14.368 * kMm, 0.5e-3 * kMm);
  EXPECT_NEAR(axial_image(eye, 0)->distance, 27.951 * kMm, 0.5e-3 * kMm);
  EXPECT_NEAR(axial_image(eye, 0)->magnification, -1.028, 0.5e-3);
  EXPECT_NEAR(-1 / system_matrix(eye, 2, 5)(0, 1), -32.6 * kMm, 0.05 * kMm);
  EXPECT_NEAR(-1 / system_matrix(model_eye_5_3(), 2, 5)(0, 1), 18.898 * kMm, 0.5e-3 * kMm);
  EXPECT_NEAR(-1.403 / system_matrix(model_eye_5_3(), 2, 5)(0, 1), 26.513 * kMm, 0.5e-3 * kMm);
}

TEST(FirstOrder, TheCondensingLensAloneHasItsFocalLength) {
  const System eye = prescription("navarro_condensing").system;
  const Eigen::Matrix2d lens = system_matrix(eye, 6, 7);
  EXPECT_NEAR(-1 / lens(0, 1), 12.67088 * kMm, kPrinted);
  // Back focal distance: where light that comes in parallel meets the axis.
  EXPECT_NEAR(-lens(1, 1) / lens(0, 1), 7.81547 * kMm, kPrinted);
}

TEST(FirstOrder, ImagesOfObjectsOnTheAxisAreThoseOfFigures32b33band34b) {
  struct Row {
    const char* name;
    std::array<double, 11> image_mm;
    double digit;  // half a unit of the last printed digit, mm
  };
  const std::array<Row, 3> table{{
      {"navarro_vitrectomy",
       {-19.484, -18.592, -17.716, -16.854, -16.007, -15.175, -14.356, -13.550, -12.758, -11.978,
        -11.211},
       5e-4},
      {"navarro_condensing",
       {7.857, 8.324, 8.848, 9.437, 10.106, 10.871, 11.756, 12.791, 14.017, 15.493, 17.304},
       5e-4},
      {"model_eye_5_3",
       {8.985, 9.438, 9.939, 10.498, 11.125, 11.832, 12.636, 13.558, 14.628, 15.882, 17.375},
       5e-4},
  }};
  for (const Row& row : table) {
    const System eye = prescription(row.name).system;
    for (int d = 0; d <= 10; ++d) {
      EXPECT_NEAR(axial_image(eye, d * kMm)->distance, row.image_mm[d] * kMm,
                  row.digit * 1.001 * kMm)
          << row.name << d;
    }
  }
  const std::array<double, 11> bare{-3882,  -319.85, -159.95, -103.42, -74.50, -56.93,
                                    -45.13, -36.66,  -30.28,  -25.31,  -21.32};
  const System navarro = prescription("navarro").system;
  for (int d = 0; d <= 10; ++d) {
    EXPECT_NEAR(axial_image(navarro, d * kMm)->distance, bare[d] * kMm,
                (d == 0 ? 0.5 : 0.00501) * kMm)
        << d;
  }
}

TEST(FirstOrder, MatricesHaveDeterminantOneAndMultiplyToTheWhole) {
  const System eye = prescription("porcine_condensing").system;
  const Eigen::Matrix2d whole = system_matrix(eye);
  EXPECT_NEAR(whole.determinant(), 1, 1e-12);  // a dozen products of numbers of order 100
  const Eigen::Matrix2d parts = system_matrix(eye, 4) *
                                transfer_matrix(eye.surfaces[2].thickness, eye.surfaces[2].index) *
                                system_matrix(eye, 2, 3);
  EXPECT_NEAR((whole - parts).norm() / whole.norm(), 0, 1e-14);
}

TEST(FirstOrder, AreTheLimitOfTracedRays) {
  const System eye = prescription("navarro_condensing").system;
  for (double depth : {0.0, 3e-3, 8e-3}) {
    const double slope =
        1e-5;  // the third order is 1e-10 of it, and 1 um of height is rounded at 1e-16
    const TraceResult traced =
        trace_out(eye, {Eigen::Vector3d(0, 0, depth), Eigen::Vector3d(slope, 0, 1).normalized()});
    ASSERT_EQ(traced.status, TraceStatus::ok);
    const auto& [origin, direction] = traced.ray;
    const double crossing = origin.z() - origin.x() * direction.z() / direction.x() - eye.vertex(7);
    EXPECT_NEAR(crossing, axial_image(eye, depth)->distance, 1e-9) << depth;
  }
}

TEST(FirstOrder, CardinalPointsHangTogether) {
  const auto points = cardinal_points(prescription("navarro").system);
  ASSERT_TRUE(points);
  // An object at the front focus has its image at infinity: 0.094 mm behind the retina, so none in
  // the vitreous has.
  EXPECT_NEAR(-points->front_focus - 16.32 * kMm, 0.094 * kMm, 0.5e-3 * kMm);
  EXPECT_NEAR(points->second_nodal_point - points->first_nodal_point,
              points->second_principal_point - points->first_principal_point, 1e-15);
  const double index_ratio = points->front_focal_length / points->back_focal_length;
  EXPECT_NEAR(index_ratio, 1.336, 1e-14);
}

TEST(FirstOrder, AnAfocalSystemHasNoCardinalPointsAndACollimatedImageIsNone) {
  System window = one_surface(std::numeric_limits<double>::infinity(), 0, 1.336, 1);
  EXPECT_FALSE(cardinal_points(window));
  EXPECT_NEAR(axial_image(window, 0)->distance, -20 * kMm / 1.336, 1e-15);
  const double R = -10 * kMm, n = 1.336;
  const System collimator =
      one_surface(R, 0, n, 1, -R * n / (n - 1));  // its front focus on the retina
  EXPECT_FALSE(axial_image(collimator, 0));
  EXPECT_TRUE(axial_image(collimator, 1 * kMm));
  EXPECT_FALSE(secant_slope(collimator, 1 * kMm));
}

TEST(FirstOrder, RefusesNumbersThatWouldOverflow) {
  System eye = prescription("navarro").system;
  for (int i = 1; i < 5; ++i) eye.surfaces[i].radius = 1e-300;
  expect_refused("system", [&] { (void)cardinal_points(eye); });
  expect_refused("system", [&] { (void)axial_image(eye, 0); });
  eye = prescription("navarro").system;
  eye.surfaces[1].index = 1e300;
  expect_refused("surface 2: index", [&] { (void)cardinal_points(eye); });
}

TEST(FirstOrder, RefusesWhatIsNotThere) {
  const System eye = prescription("navarro").system;
  expect_refused("depth", [&] { (void)axial_image(eye, -1e-6); });
  expect_refused("depth", [&] { (void)axial_image(eye, 17e-3); });
  expect_refused("depth", [&] { (void)axial_image(eye, std::nan("")); });
  expect_refused("depth", [&] { (void)secant_slope(eye, 0); });
  expect_refused("from", [&] { (void)system_matrix(eye, 1); });
  expect_refused("to", [&] { (void)system_matrix(eye, 2, 9); });
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
