// SPDX-License-Identifier: Apache-2.0
#include "optics/rays/trace.h"

#include "optics/system/refraction.h"
#include "tests/optics/support.h"

#include <Eigen/Geometry>
#include <ceres/jet.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
// Issue 3 asks for 1e-10 mm per ray; a chain of seven surfaces rounds to about 1e-14 mm.
constexpr double kExact = 1e-13;  // m

Ray ray_through(const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  return {from, (to - from).normalized()};
}

/// Where the ray crosses the axis, for a ray in the plane y = 0.
double axis_crossing(const Ray& ray) {
  return ray.origin.z() - ray.origin.x() * ray.direction.z() / ray.direction.x();
}

/// Rays from points 0 to 8 mm deep and 5 mm off axis to points within 1 mm of the pupil's center.
std::vector<Ray> bundle(const System& system, int count) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> unit(-1, 1);
  const double pupil = system.vertex(3);
  std::vector<Ray> rays;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d from(5 * kMm * unit(random), 5 * kMm * unit(random),
                               4 * kMm * (1 + unit(random)));
    rays.push_back(ray_through(from, {1 * kMm * unit(random), 1 * kMm * unit(random), pupil}));
  }
  return rays;
}

TEST(Trace, ParallelRayAtASphereCrossesTheAxisWhereTheSineLawSays) {
  const double R = 8 * kMm, n1 = 1.0, n2 = 1.5, vertex = 20 * kMm;
  const System system = one_surface(R, 0, n1, n2, vertex);
  for (double h : {0.01 * kMm, 1 * kMm, 4 * kMm, 7.5 * kMm}) {
    const TraceResult out = trace_out(system, {{h, 0, 0}, {0, 0, 1}});
    ASSERT_EQ(out.status, TraceStatus::ok);
    const double in = std::asin(h / R), refracted = std::asin(n1 / n2 * h / R);
    const double expected = vertex + R + R * std::sin(refracted) / std::sin(in - refracted);
    // asin and the division by a small angle lose digits in the expectation itself at the smallest
    // height.
    EXPECT_NEAR(axis_crossing(out.ray), expected, 1e-12) << h;
  }
}

TEST(Trace, AplanaticPointsOfASphereAreImagedWithoutAberrationBySkewRays) {
  // A point at R n2/n1 from the center of a sphere of index n1 is seen at R n1/n2... exactly, at
  // any angle (Weierstrass).
  const double R = 5 * kMm, n1 = 1.5, n2 = 1.0, vertex = 20 * kMm;
  const System system = one_surface(-R, 0, n1, n2, vertex);
  const double center = vertex - R;
  const Eigen::Vector3d object(0, 0, center - R * n2 / n1), image(0, 0, center - R * n1 / n2);
  for (double slope : {0.01, 0.3, 0.8}) {
    for (double azimuth : {0.0, 1.0, 2.5, 4.0}) {
      const Eigen::Vector3d d =
          Eigen::Vector3d(slope * std::cos(azimuth), slope * std::sin(azimuth), 1).normalized();
      const TraceResult out = trace_out(system, {object, d});
      ASSERT_EQ(out.status, TraceStatus::ok) << slope;
      EXPECT_LT((image - out.ray.origin).cross(out.ray.direction).norm(), kExact) << slope;
    }
  }
}

TEST(Trace, EllipsoidOfMatchingEccentricityFocusesParallelSkewRaysInOnePoint) {
  const double R = 6 * kMm, n1 = 1.0, n2 = 1.6, vertex = 20 * kMm;
  const System system = one_surface(R, -(n1 * n1) / (n2 * n2), n1, n2, vertex);
  const Eigen::Vector3d focus(0, 0, vertex + R * n2 / (n2 - n1));
  for (double x : {-4 * kMm, 0.3 * kMm, 3 * kMm}) {
    const TraceResult out = trace_out(system, {{x, 1.7 * kMm, 0}, {0, 0, 1}});
    ASSERT_EQ(out.status, TraceStatus::ok);
    EXPECT_LT((focus - out.ray.origin).cross(out.ray.direction).norm(), kExact);
  }
}

TEST(Trace, NearAxialRaysKeepTheirDigitsOnAParaboloid) {
  // A -> 0 there: the schoolbook root loses up to 2.4e-9 mm (facts on optics, 1).
  const double R = 6 * kMm, vertex = 20 * kMm;
  const System system = one_surface(R, -1, 1.336, 1.42, vertex);
  for (double tilt : {0.0, 1e-9, 1e-7, 1e-5}) {
    const Ray ray{{1 * kMm, 0, 0}, Eigen::Vector3d(tilt, 0, 1).normalized()};
    const Eigen::Vector3d hit = trace_out(system, ray).ray.origin;
    EXPECT_NEAR(hit.z() - vertex, hit.x() * hit.x() / (2 * R), 1e-17) << tilt;
  }
}

TEST(Trace, EveryHitLiesOnTheSurfaceAndObeysSnell) {
  System system = navarro_with_condensing_lens(true);
  for (const Ray& start : bundle(system, 300)) {
    Ray ray = start;
    for (int number = 2; number <= system.size(); ++number) {
      System part = system;  // the eye up to this surface
      part.surfaces.resize(number);
      part.stop.reset();
      const TraceResult out = trace_out(part, start);
      if (out.status != TraceStatus::ok) break;
      const Surface& surface = system.surfaces[number - 1];
      const Eigen::Vector3d hit = out.ray.origin - Eigen::Vector3d(0, 0, system.vertex(number));
      const double r = std::hypot(hit.x(), hit.y());
      EXPECT_NEAR(hit.z(), surface.sag(r), kExact);
      const double step = 1 * kUm;  // central difference: error about step^2/R^2 of the slope, 1e-8
      const double slope = (surface.sag(r + step) - surface.sag(r - step)) / (2 * step);
      const Eigen::Vector3d normal =
          Eigen::Vector3d(-slope * hit.x() / r, -slope * hit.y() / r, 1).normalized();
      const double before = system.surfaces[number - 2].index;
      EXPECT_LT((before * ray.direction - surface.index * out.ray.direction).cross(normal).norm(),
                1e-6);
      EXPECT_NEAR(out.ray.direction.norm(), 1, 1e-14);
      ray = out.ray;
    }
  }
}

TEST(Trace, RaysAreReversible) {
  for (const System& system :
       {model_eye_5_3(), navarro_with_condensing_lens(false), navarro_with_condensing_lens(true)}) {
    int passed = 0;
    for (const Ray& ray : bundle(system, 500)) {
      const TraceResult out = trace_out(system, ray);
      if (out.status != TraceStatus::ok) continue;
      const TraceResult back =
          trace_in(system, {out.ray.origin + 0.02 * out.ray.direction, -out.ray.direction});
      ASSERT_EQ(back.status, TraceStatus::ok);
      EXPECT_LT((ray.origin - back.ray.origin).cross(back.ray.direction).norm(), kExact);
      EXPECT_LT((ray.direction + back.ray.direction).norm(),
                1e-11);  // kExact over the centimeter to the next surface
      ++passed;
    }
    EXPECT_GT(passed, 350);  // the rest is clipped or meets no surface
  }
}

struct FirstOrder {
  System system;
  double focal_mm, image_mm, magnification;
};

TEST(Trace, ParaxialRaysGiveTheFirstOrderDataOfTheFacts) {
  // Facts on optics, 2: five decimals, so half of the last. A ray 1 um off axis strays by (1 um /
  // 10 mm)^2 = 1e-8.
  const double h = 1 * kUm, last_digit = 0.6e-5;
  for (const auto& [system, focal, image, magnification] :
       {FirstOrder{model_eye_5_3(), 11.39315, 8.98468, -0.77752},
        FirstOrder{navarro_with_condensing_lens(false), 10.83323, 7.85687, -0.76906},
        FirstOrder{navarro_with_condensing_lens(true), 10.83323, 7.85687, -0.76906}}) {
    const double last = system.vertex(system.size());
    const Ray parallel = trace_out(system, {{h, 0, 0}, {0, 0, 1}}).ray;
    EXPECT_NEAR(-h * parallel.direction.z() / parallel.direction.x() / kMm, focal, last_digit);
    const Ray from_retina = trace_out(system, ray_through({0, 0, 0}, {h, 0, system.vertex(2)})).ray;
    const double image_z = axis_crossing(from_retina);
    EXPECT_NEAR((image_z - last) / kMm, image, last_digit);
    const Ray off_axis = trace_out(system, {{h, 0, 0}, {0, 0, 1}}).ray;
    const double height = off_axis.origin.x() + (image_z - off_axis.origin.z()) *
                                                    off_axis.direction.x() / off_axis.direction.z();
    EXPECT_NEAR(height / h, magnification, last_digit);
  }
}

TEST(Trace, ObjectsOnTheAxisAreImagedWhereTheFactsSay) {
  const System eye = model_eye_5_3();
  const double image_mm[] = {8.985,  9.438,  9.939,  10.498, 11.125, 11.832,
                             12.636, 13.558, 14.628, 15.882, 17.375};
  for (int depth = 0; depth <= 10; ++depth) {
    const Ray out =
        trace_out(eye, ray_through({0, 0, depth * kMm}, {1 * kUm, 0, eye.vertex(2)})).ray;
    EXPECT_NEAR((axis_crossing(out) - eye.vertex(7)) / kMm, image_mm[depth], 0.6e-3)
        << depth;  // three decimals
  }
}

TEST(Trace, StopIsAHoleInTheVertexPlaneOfItsSurface) {
  System system;  // planes in air: the ray stays straight
  system.surfaces = {make_surface(12 * kMm, 0, 10 * kMm, 1), Surface{}, Surface{}};
  system.surfaces[1].thickness = 5 * kMm;
  system.stop = Stop{3, 1.5 * kMm};
  const auto status = [&](double r) {
    return trace_out(system, ray_through({0, 0, 0}, {0, r, 15 * kMm}));
  };
  EXPECT_EQ(status(1.4999 * kMm).status, TraceStatus::ok);
  EXPECT_EQ(status(1.5001 * kMm).status, TraceStatus::clipped);
  EXPECT_EQ(status(1.5001 * kMm).surface, 3);
}

TEST(Trace, StopBesideACurvedSurfaceClipsBothDirectionsAlike) {
  // surface 3 bends away from its vertex plane: 0.1 mm at the edge of the hole
  const System eye = model_eye_5_3();
  for (double side : {-1.0, 1.0}) {
    double inside = 0, outside = 0.3;
    System open = eye;
    open.stop.reset();
    const auto ray = [&](double slope) {
      return Ray{{-4 * kMm * side, 0, 0}, Eigen::Vector3d(side * (slope + 0.1), 0, 1).normalized()};
    };
    for (int i = 0; i < 50; ++i) {
      const double middle = (inside + outside) / 2;
      (trace_out(eye, ray(middle)).status == TraceStatus::ok ? inside : outside) = middle;
    }
    for (double slope : {inside - 1e-9, inside + 1e-9}) {
      const Ray out = trace_out(open, ray(slope)).ray;
      EXPECT_EQ(trace_in(eye, {out.origin + 0.01 * out.direction, -out.direction}).status,
                trace_out(eye, ray(slope)).status);
    }
    const TraceResult lost = trace_out(eye, ray(inside + 1e-9));
    EXPECT_EQ(lost.status, TraceStatus::clipped);
    EXPECT_EQ(lost.surface, 3);
  }
}

TEST(Trace, SemiDiameterClipsAtTheHit) {
  System system = one_surface(20 * kMm, 0, 1, 1.5);
  system.surfaces[1].semi_diameter = 3 * kMm;
  EXPECT_EQ(trace_out(system, {{2.999 * kMm, 0, 0}, {0, 0, 1}}).status, TraceStatus::ok);
  EXPECT_EQ(trace_out(system, {{3.001 * kMm, 0, 0}, {0, 0, 1}}).status, TraceStatus::clipped);
}

TEST(Trace, TotalReflectionBeginsAtTheCriticalAngle) {
  const System system = one_surface(std::numeric_limits<double>::infinity(), 0, 1.5, 1.0);
  const double critical = std::asin(1 / 1.5);
  const auto at = [&](double angle) {
    return trace_out(system, {{0, 0, 0}, {std::sin(angle), 0, std::cos(angle)}});
  };
  EXPECT_EQ(at(critical - 1e-6).status, TraceStatus::ok);
  EXPECT_EQ(at(critical + 1e-6).status, TraceStatus::total_reflection);
  EXPECT_EQ(at(critical + 1e-6).surface, 2);
}

TEST(Trace, LostRaysSayWhyAndWhere) {
  const System sphere = one_surface(5 * kMm, 0, 1, 1.5);
  EXPECT_EQ(trace_out(sphere, {{6 * kMm, 0, 0}, {0, 0, 1}}).status, TraceStatus::missed);
  EXPECT_EQ(trace_out(sphere, {{0, 0, 0}, {1, 0, 0}}).status,
            TraceStatus::missed);  // along the surface
  EXPECT_EQ(trace_out(sphere, {{0, 0, 0}, {0, 0, -1}}).status,
            TraceStatus::missed);  // away from it
  EXPECT_EQ(trace_out(sphere, {{0, 0, 30 * kMm}, {0, 0, 1}}).status,
            TraceStatus::missed);  // already behind it
  EXPECT_EQ(trace_out(sphere, {{6 * kMm, 0, 0}, {0, 0, 1}}).surface, 2);
  // A hyperboloid opening to +z: a steep ray from afar meets the branch that (3.1) does not
  // describe.
  const System hyperboloid = one_surface(5 * kMm, -4, 1, 1.5);
  const Ray steep{{30 * kMm, 0, 0}, Eigen::Vector3d(-1, 0, 0.3).normalized()};
  EXPECT_EQ(trace_out(hyperboloid, steep).status, TraceStatus::wrong_sheet);
}

TEST(Trace, SurfacesThatCrossAtTheRaysHeightLoseIt) {
  System lens =
      one_surface(10 * kMm, 0, 1, 1.5);  // biconvex and only 0.1 mm thick: 1.4 mm across at most
  lens.surfaces[1].thickness = 0.1 * kMm;
  lens.surfaces.push_back(make_surface(-10 * kMm, 0, 0, 1));
  EXPECT_EQ(trace_out(lens, {{0.5 * kMm, 0, 0}, {0, 0, 1}}).status, TraceStatus::ok);
  const TraceResult crossed = trace_out(lens, {{2 * kMm, 0, 0}, {0, 0, 1}});
  EXPECT_EQ(crossed.status, TraceStatus::missed);
  EXPECT_EQ(crossed.surface, 3);
}

TEST(Trace, RaysThatAreNotRaysAreRefused) {
  const System eye = model_eye_5_3();
  expect_refused("ray", [&] { trace_out(eye, {{kNan, 0, 0}, {0, 0, 1}}); });
  expect_refused("ray", [&] { trace_out(eye, {{0, 0, 0}, {0, kNan, 1}}); });
  expect_refused("ray", [&] { trace_out(eye, {{0, 0, 0}, {0, 0, 2}}); });
  expect_refused("ray", [&] { trace_in(eye, {{0, 0, 1}, {0, 0, 0}}); });
}

TEST(Trace, NoStartLeadsToANumberThatIsNotOne) {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> place(-0.05, 0.05), unit(-1, 1);
  const System eye = navarro_with_condensing_lens(true);
  for (int i = 0; i < 20000; ++i) {
    const Eigen::Vector3d d =
        Eigen::Vector3d(unit(random), unit(random), unit(random)).normalized();
    const Ray ray{{place(random), place(random), place(random)}, d};
    for (const TraceResult& result : {trace_out(eye, ray), trace_in(eye, ray)}) {
      ASSERT_TRUE(result.ray.origin.allFinite() && result.ray.direction.allFinite());
      ASSERT_EQ(result.status == TraceStatus::ok, result.surface == 0);
    }
  }
}

TEST(Trace, JetsCarryTheDerivativesThroughAnAsphere) {
  using Jet = ceres::Jet<double, 2>;
  const System system = navarro_with_condensing_lens(true);
  const detail::Crossing crossing{system.surfaces[5], 1.0 / 1.523};
  const auto slope_of = [&](const auto& x, const auto& tilt) {
    using T = std::decay_t<decltype(x)>;
    detail::Vector3<T> origin(x, T(1e-3), T(-2e-3));
    detail::Vector3<T> direction = detail::Vector3<T>(tilt, T(0.1), T(1)).normalized();
    EXPECT_EQ(detail::cross(crossing, origin, direction), TraceStatus::ok);
    return T(direction.x() / direction.z());
  };
  const Jet slope = slope_of(Jet(3e-3, 0), Jet(0.2, 1));
  const double h =
      1e-6;  // central differences: rounding 1e-16/h and curvature h^2 leave about 1e-9
  EXPECT_NEAR(slope.v[1], (slope_of(3e-3, 0.2 + h) - slope_of(3e-3, 0.2 - h)) / (2 * h), 1e-7);
  const double step = 1e-8;  // m; the derivative is some 100 per m
  EXPECT_NEAR(slope.v[0], (slope_of(3e-3 + step, 0.2) - slope_of(3e-3 - step, 0.2)) / (2 * step),
              1e-4);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
