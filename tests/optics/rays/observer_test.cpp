// SPDX-License-Identifier: Apache-2.0
#include "optics/rays/observer.h"

#include "tests/optics/support.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kExact = 1e-13;  // m; as in trace_test: rounding over the chain

/// Distance of a point from a ray's line, m.
double distance(const Ray& ray, const Eigen::Vector3d& point) {
  return (point - ray.origin).cross(ray.direction).norm();
}

Eigen::Vector3d focus_point(const System& system, const Microscope& microscope) {
  return {microscope.decenter.x(), microscope.decenter.y(),
          system.vertex(system.size()) + microscope.focus};
}

/// Two lines are the same when two points of the one lie on the other.
void expect_same_line(const Ray& a, const Ray& b, double tolerance) {
  EXPECT_LT(distance(a, b.origin), tolerance);
  EXPECT_LT(distance(a, b.origin - 0.01 * b.direction), tolerance);
}

TEST(Observer, TelecentricChiefRaysAreParallelToTheAxis) {
  const System eye = model_eye_5_3();
  const Ray chief = chief_ray_in_air(eye, Microscope{}, {2 * kMm, -3 * kMm});
  EXPECT_EQ(chief.direction, Eigen::Vector3d(0, 0, 1));
  EXPECT_EQ(chief.origin, focus_point(eye, Microscope{}) + Eigen::Vector3d(2 * kMm, -3 * kMm, 0));
}

TEST(Observer, ChiefRaysOfAFinitePupilMeetInItsCenter) {
  const System eye = model_eye_5_3();
  for (double pupil_distance : {0.1, 0.15, -0.2}) {
    Microscope microscope;
    microscope.pupil_distance = pupil_distance;
    microscope.decenter = {0.2 * kMm, -0.1 * kMm};
    const Eigen::Vector3d pupil =
        focus_point(eye, microscope) + Eigen::Vector3d(0, 0, pupil_distance);
    for (double x : {-5 * kMm, 0.0, 3 * kMm}) {
      const Ray chief = chief_ray_in_air(eye, microscope, {x, 1 * kMm});
      EXPECT_LT(distance(chief, pupil), 1e-16);  // rounding at 0.1 m
      EXPECT_GT(chief.direction.z(), 0);
    }
  }
}

TEST(Observer, IsopixelLinesTracedOutAgainAreTheChiefRays) {
  const System eye = model_eye_5_3();
  for (double pupil_distance : {std::numeric_limits<double>::infinity(), 0.15}) {
    Microscope microscope;
    microscope.pupil_distance = pupil_distance;
    microscope.decenter = {0.3 * kMm, -0.2 * kMm};
    microscope.tilt = {0.01, -0.02};
    for (double x = -5 * kMm; x <= 5 * kMm; x += 1 * kMm) {
      const Eigen::Vector2d m(x, 0.4 * x + 0.3 * kMm);
      const auto line = isopixel_line(eye, microscope, m);
      ASSERT_TRUE(line);
      EXPECT_GT(line->direction.z(), 0);
      const TraceResult out =
          trace_out(eye, {line->origin - 0.005 * line->direction, line->direction});
      ASSERT_EQ(out.status, TraceStatus::ok);
      expect_same_line(out.ray, chief_ray_in_air(eye, microscope, m), kExact);
    }
  }
}

TEST(Observer, TheImageIsInverted) {
  const auto line = isopixel_line(model_eye_5_3(), Microscope{}, {3 * kMm, 0});
  ASSERT_TRUE(line);
  const double x_at_5mm =
      line->origin.x() + (5 * kMm - line->origin.z()) * line->direction.x() / line->direction.z();
  EXPECT_LT(x_at_5mm, -2 * kMm);
}

TEST(Observer, DecenteringATelecentricMicroscopeShiftsTheImage) {
  const System eye = model_eye_5_3();
  Microscope shifted;
  shifted.decenter = {0.5 * kMm, -0.25 * kMm};
  const Eigen::Vector2d m(2 * kMm, 1 * kMm);
  const auto line = isopixel_line(eye, shifted, m);
  const auto same = isopixel_line(eye, Microscope{}, m + shifted.decenter);
  ASSERT_TRUE(line && same);
  expect_same_line(*line, *same, kExact);
}

TEST(Observer, TiltTurnsAboutTheObjectInFocus) {
  // Whatever the small tilt, the ray from the axis of the focus plane passes through the object
  // that is sharp there: the one whose own paraxial image lies in the focus plane.
  const System eye = model_eye_5_3();
  Microscope microscope;
  double crossing[2];
  int i = 0;
  for (double angle : {1e-4, -2e-4}) {
    microscope.tilt = {0, angle};
    const Ray chief = chief_ray_in_air(eye, microscope, {0, 0});
    EXPECT_NEAR(chief.direction.x(), std::sin(angle), 1e-15);  // about y: +z leans towards +x
    const auto line = isopixel_line(eye, microscope, {0, 0});
    ASSERT_TRUE(line);
    crossing[i++] = line->origin.z() - line->origin.x() * line->direction.z() / line->direction.x();
  }
  EXPECT_NEAR(crossing[0], crossing[1],
              10e-9);  // m; spherical aberration goes with the square of the tilt
  // Facts on optics, 2: 5 mm is imaged at 11.832 mm, 6 mm at 12.636; the line between bends by 0.02
  // mm.
  EXPECT_NEAR(crossing[0] / kMm, 5 + (12.3 - 11.832) / (12.636 - 11.832), 0.03);
  microscope.tilt = {0.01, 0};
  EXPECT_NEAR(chief_ray_in_air(eye, microscope, {0, 0}).direction.y(), -std::sin(0.01),
              1e-15);  // about x: towards -y
}

TEST(Observer, AFocusPlaneInsideTheLensIsNoObstacle) {
  Microscope virtual_image;
  virtual_image.focus = -10 * kMm;
  const auto line = isopixel_line(model_eye_5_3(), virtual_image, {2 * kMm, 0});
  const auto same = isopixel_line(model_eye_5_3(), Microscope{},
                                  {2 * kMm, 0});  // telecentric: the focus moves no ray
  ASSERT_TRUE(line && same);
  expect_same_line(*line, *same, kExact);
}

TEST(Observer, RaysThatTheIrisBlocksSeeNothing) {
  const System eye = model_eye_5_3();
  EXPECT_FALSE(isopixel_line(eye, Microscope{}, {30 * kMm, 0}));
  Microscope askew;
  askew.tilt = {0, 0.2};  // f tan(0.2) = 2.3 mm in the pupil, whose radius is 1.5 mm
  EXPECT_FALSE(isopixel_line(eye, askew, {0, 0}));
}

TEST(Observer, CheckNamesTheParameter) {
  const auto refused = [](const std::string& name, auto spoil) {
    Microscope microscope;
    EXPECT_NO_THROW(microscope.check());
    spoil(microscope);
    expect_refused(name, [&] { microscope.check(); });
  };
  refused("numerical_aperture", [](Microscope& m) { m.numerical_aperture = 0; });
  refused("numerical_aperture", [](Microscope& m) { m.numerical_aperture = kNan; });
  refused("focus", [](Microscope& m) { m.focus = kNan; });
  refused("pupil_distance", [](Microscope& m) { m.pupil_distance = 0; });
  refused("pupil_distance", [](Microscope& m) { m.pupil_distance = kNan; });
  refused("decenter", [](Microscope& m) { m.decenter.x() = kNan; });
  refused("tilt", [](Microscope& m) { m.tilt.y() = 1; });
  refused("tilt", [](Microscope& m) { m.tilt.x() = kNan; });
  expect_refused("m", [] { (void)isopixel_line(model_eye_5_3(), Microscope{}, {kNan, 0}); });
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
