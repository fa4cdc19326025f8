// SPDX-License-Identifier: Apache-2.0
#include "optics/projection/single_viewpoint.h"

#include "tests/optics/support.h"

#include <ceres/jet.h>
#include <gtest/gtest.h>

#include <cmath>
#include <iostream>
#include <limits>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

SingleViewpoint fitted(const Microscope& microscope = {}) {
  return fit_single_viewpoint(model_eye_5_3(), microscope, 7 * kMm);
}

SingleViewpoint with_slopes(double a, double b, double c, double d, double max_m) {
  SingleViewpoint view;
  view.viewpoint = 20 * kMm;
  view.max_z = 15 * kMm;
  view.max_m = max_m;
  view.slope_from_m = {a, b, c, d};
  return view;
}

Eigen::Vector3d point_on(const Ray& line, double z) {
  return line.origin + line.direction * ((z - line.origin.z()) / line.direction.z());
}

TEST(SingleViewpoint, ViewpointIsTheMedianOfTheCurvesIntersectionsWithTheAxis) {
  const SingleViewpoint view = fitted();
  int before = 0, behind = 0;
  for (int i = 1; i <= 41; ++i) {
    const auto line = isopixel_line(model_eye_5_3(), Microscope{}, {view.max_m * i / 41, 0});
    ASSERT_TRUE(line);
    const double z =
        line->origin.z() - line->origin.x() * line->direction.z() / line->direction.x();
    before += z < view.viewpoint - 1e-12;
    behind += z > view.viewpoint + 1e-12;
  }
  EXPECT_EQ(before, 20);
  EXPECT_EQ(behind, 20);
}

TEST(SingleViewpoint, ProjectsPointsOfTheSquareNearTheirTracedPixel) {
  // The lines do not really meet in one point: their intersections with the axis spread over 0.5
  // mm, slope 0.4, which is 0.05 mm of aerial image at worst. A budget for the thesis'
  // simplification, not for rounding.
  const System eye = model_eye_5_3();
  const SingleViewpoint view = fitted();
  double worst = 0, sum = 0;
  int count = 0;
  for (double m = 0.1 * kMm; m < 6.5 * kMm; m += 0.2 * kMm) {
    const auto line = isopixel_line(eye, Microscope{}, {m, 0});
    ASSERT_TRUE(line);
    for (double z = 2 * kMm; z <= 8 * kMm; z += 1 * kMm) {
      const Eigen::Vector3d point = point_on(*line, z);
      if (std::abs(point.x()) > 5 * kMm) continue;  // the square and the robot's own length
      const auto projected = view.project(point);
      ASSERT_TRUE(projected);
      const double error = (*projected - Eigen::Vector2d(m, 0)).norm();
      worst = std::max(worst, error);
      sum += error * error;
      ++count;
    }
  }
  std::cout << "projection against traced chief rays over the square, aerial image: rms "
            << std::sqrt(sum / count) / kUm << " um, max " << worst / kUm << " um\n";
  EXPECT_LT(worst, 40 * kUm);
  EXPECT_LT(std::sqrt(sum / count), 15 * kUm);
}

TEST(SingleViewpoint, AzimuthIsKeptInAllQuadrantsAndTheImageInverted) {
  const SingleViewpoint view = fitted();
  const double reference = view.project({2 * kMm, 0, 5 * kMm})->norm();
  for (double azimuth = -3; azimuth < 3.2; azimuth += 0.25) {
    const Eigen::Vector2d along(std::cos(azimuth), std::sin(azimuth));
    const auto m = view.project({2 * kMm * along.x(), 2 * kMm * along.y(), 5 * kMm});
    ASSERT_TRUE(m);
    EXPECT_LT((*m + reference * along).norm(), 1e-14) << azimuth;  // rounding of mm
  }
}

TEST(SingleViewpoint, NothingTearsOnTheAxis) {
  const SingleViewpoint view = fitted();
  EXPECT_EQ(*view.project({0, 0, 5 * kMm}), Eigen::Vector2d(0, 0));
  const double magnification = -view.project({1 * kUm, 0, 5 * kMm})->x() / (1 * kUm);
  for (double x : {1e-16, 1e-13, 1e-10, 1e-8}) {
    // |m|^2 in (5.2) bends the image by some 1e-4 of m at 1 um; below that it is straight.
    EXPECT_NEAR(-view.project({x, 0, 5 * kMm})->x() / x, magnification, 1e-4 * magnification) << x;
  }
}

TEST(SingleViewpoint, RealRootsOfEveryKindOfCubicAreFound) {
  const double max_m = 7 * kMm;
  const SingleViewpoint views[] = {
      with_slopes(33854, 10, 63.4, 0, max_m),    // like the 5.3 eye: D^2 > 0
      with_slopes(-2e4, 0, 63.4, 0, max_m),      // bends the other way: three real roots, D^2 < 0
      with_slopes(-1e5, 1500, 63.4, 0, max_m),   // the same with an even term
      with_slopes(0, 500, 63.4, 0, max_m),       // a = 0: a quadratic
      with_slopes(0, 0, 63.4, 0, max_m),         // a line
      with_slopes(1e-9, 0, 63.4, 0, max_m),      // a -> 0
      with_slopes(140, 10, 63.4, 0.001, max_m),  // just above the limit where the formula is left
      with_slopes(33854, 10, 63.4, -0.002, max_m),  // d as the thesis may fit it
  };
  for (const SingleViewpoint& view : views) {
    EXPECT_NO_THROW(view.check());
    for (double h = max_m / 50; h <= max_m; h += max_m / 50) {
      const auto root = detail::height_from_slope(view, detail::slope_at(view, h));
      ASSERT_TRUE(root) << h;
      EXPECT_NEAR(*root, h, 1e-15) << view.slope_from_m[0];  // Newton polishes to rounding
    }
    EXPECT_FALSE(detail::height_from_slope(view, detail::slope_at(view, max_m) + 1e-3));
  }
}

TEST(SingleViewpoint, JetsCarryTheProjectionsDerivatives) {
  using Jet = ceres::Jet<double, 3>;
  const SingleViewpoint view = fitted();
  for (const Eigen::Vector3d& at :
       {Eigen::Vector3d(1e-3, -2e-3, -15e-3), Eigen::Vector3d(0, 0, -15e-3)}) {
    detail::Vector2<Jet> m;
    ASSERT_TRUE(detail::project(
        view, detail::Vector3<Jet>(Jet(at.x(), 0), Jet(at.y(), 1), Jet(at.z(), 2)), m));
    for (int i = 0; i < 3; ++i) {
      const Eigen::Vector3d step = 1e-7 * Eigen::Vector3d::Unit(i);
      detail::Vector2<double> up, down;
      ASSERT_TRUE(detail::project(view, Eigen::Vector3d(at + step), up));
      ASSERT_TRUE(detail::project(view, Eigen::Vector3d(at - step), down));
      // Central difference of 1e-7 m; on the axis |m|^2 of (5.2) adds 1e-5 of the derivative.
      EXPECT_NEAR(m.x().v[i], (up - down).x() / 2e-7, 1e-5) << i;
      EXPECT_NEAR(m.y().v[i], (up - down).y() / 2e-7, 1e-5) << i;
    }
  }
}

TEST(SingleViewpoint, PointsOutsideTheFitHaveNoImage) {
  const SingleViewpoint view = fitted();
  EXPECT_TRUE(view.project({0, 0, 0}));
  EXPECT_FALSE(view.project({0, 0, -1 * kUm}));                  // behind the retina's vertex
  EXPECT_FALSE(view.project({0, 0, view.max_z + 1 * kUm}));      // in the lens
  EXPECT_FALSE(view.project({9 * kMm, 0, 5 * kMm}));             // wider than the fit
  EXPECT_FALSE(view.project({0, 0, view.viewpoint + 5 * kMm}));  // behind the viewpoint
  expect_refused("point_in_eye", [&] { (void)view.project({kNan, 0, 0}); });
}

TEST(SingleViewpoint, DecenterShiftsTheImage) {
  Microscope shifted;
  shifted.decenter = {0.5 * kMm, -0.2 * kMm};
  const Eigen::Vector3d point(1 * kMm, 2 * kMm, 5 * kMm);
  EXPECT_LT((*fitted(shifted).project(point) + shifted.decenter - *fitted().project(point)).norm(),
            1e-15);
}

TEST(SingleViewpoint, LostOuterRaysShortenTheFitAndTooManyRefuseIt) {
  const System eye = model_eye_5_3();
  const SingleViewpoint cut = fit_single_viewpoint(eye, {}, 14 * kMm, 56);
  EXPECT_LT(cut.max_m, 13 * kMm);
  EXPECT_TRUE(isopixel_line(eye, {}, {cut.max_m, 0}));
  EXPECT_FALSE(isopixel_line(eye, {}, {cut.max_m + 0.25 * kMm, 0}));
  expect_refused("max_m", [&] { fit_single_viewpoint(eye, {}, 50 * kMm); });
}

TEST(SingleViewpoint, BadArgumentsAreNamed) {
  const System eye = model_eye_5_3();
  expect_refused("max_m", [&] { fit_single_viewpoint(eye, {}, -1); });
  expect_refused("max_m", [&] { fit_single_viewpoint(eye, {}, kNan); });
  expect_refused("samples", [&] { fit_single_viewpoint(eye, {}, 7 * kMm, 3); });
  expect_refused("fit_to_z", [&] { fit_single_viewpoint(eye, {}, 7 * kMm, 41, 8 * kMm, 2 * kMm); });
  expect_refused("surfaces", [&] { fit_single_viewpoint(System{}, {}, 7 * kMm); });
  SingleViewpoint ambiguous = fitted();
  ambiguous.slope_from_m[0] *= -1000;
  expect_refused("slope_from_m", [&] { ambiguous.check(); });
  expect_refused("viewpoint", [] { SingleViewpoint{}.check(); });
  ImageScale scale;
  scale.pixel = 0;
  expect_refused("pixel", [&] { scale.check(); });
}

TEST(SingleViewpoint, ImageScaleShowsWorldXToTheRightAndWorldYUp) {
  const SingleViewpoint view = fitted();
  ImageScale image;
  image.center_px = {691.5, 517.5};
  const Eigen::Vector2d pixel = image.pixel_from_m(*view.project({1 * kMm, 2 * kMm, 5 * kMm}));
  EXPECT_GT(pixel.x(), 691.5);
  EXPECT_LT(pixel.y(), 517.5);
  const Eigen::Vector2d m(1.1 * kMm, -0.7 * kMm);
  EXPECT_LT((image.m_from_pixel(image.pixel_from_m(m)) - m).norm(), 1e-15);  // rounding of 500 px
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
