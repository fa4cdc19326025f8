// Seidel sums against the limits of traced rays: small aperture, small field.
// SPDX-License-Identifier: Apache-2.0
#include "optics/analysis/aberrations.h"

#include "optics/rays/trace.h"
#include "optics/system/first_order.h"
#include "optics/system/prescriptions.h"
#include "tests/optics/support.h"

#include <gtest/gtest.h>

#include <cmath>
#include <optional>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

System small(const char* name, double stop_radius) {
  System eye = prescription(name).system;
  eye.stop->radius = stop_radius;
  return eye;
}

/// The system without a stop, so that rays that aim at it are never clipped by rounding.
System open(System eye) {
  eye.stop.reset();
  return eye;
}

/// Paraxial height at the stop of a ray from (y, 0) with slope u is b y + a u: the slope that
/// reaches `target`.
double slope_to_stop(const System& eye, double y, double target) {
  const double n = eye.surfaces[0].index;
  const Eigen::Matrix2d b =
      system_matrix(eye, 2, eye.stop->surface) * transfer_matrix(eye.surfaces[0].thickness, n);
  return (target - b(1, 1) * y) / (b(1, 0) * n);
}

/// Height of a traced ray from the flat object in the plane of the paraxial image, and its slope
/// there.
std::optional<Eigen::Vector2d> at_image(const System& eye, double y, double slope, double z) {
  const TraceResult traced =
      trace_out(open(eye), {{y, 0, 0}, Eigen::Vector3d(slope, 0, 1).normalized()});
  if (traced.status != TraceStatus::ok) return std::nullopt;
  const double tangent = traced.ray.direction.x() / traced.ray.direction.z();
  return Eigen::Vector2d(traced.ray.origin.x() + tangent * (z - traced.ray.origin.z()), tangent);
}

/// The real ray from height y through the middle of the stop's plane, by secant.
double chief_slope(const System& eye, double y) {
  System front = open(eye);
  front.surfaces.resize(static_cast<std::size_t>(eye.stop->surface - 1));
  const double z = eye.vertex(eye.stop->surface);
  const auto height = [&](double slope) {
    const auto ray = trace_out(front, {{y, 0, 0}, Eigen::Vector3d(slope, 0, 1).normalized()}).ray;
    return ray.origin.x() + ray.direction.x() / ray.direction.z() * (z - ray.origin.z());
  };
  double a = slope_to_stop(eye, y, 0), b = a * 1.001, fa = height(a), fb = height(b);
  for (int i = 0; i < 20 && std::abs(fb) > 1e-18 && fa != fb; ++i) {
    const double next = b - fb * (b - a) / (fb - fa);
    a = b;
    fa = fb;
    b = next;
    fb = height(b);
  }
  return b;
}

const char* const kEyes[] = {"navarro_condensing_conic", "navarro_condensing", "model_eye_5_3",
                             "porcine_condensing", "navarro_vitrectomy"};

TEST(Aberrations, SphericalAberrationIsTheLimitOfTheTracedMarginalRay) {
  for (const char* name : kEyes) {
    const System eye = small(name, 0.05 * kMm);
    const Aberrations sums = third_order_aberrations(eye, 1 * kMm);
    const double z = eye.vertex(eye.size()) + sums.image_distance;
    const auto ray = at_image(eye, 0, slope_to_stop(eye, 0, eye.stop->radius), z);
    ASSERT_TRUE(ray);
    const double crossing = -(*ray)[0] / (*ray)[1];
    // Fifth order against third: the aperture squared, 1/30 of the eye's own, so 1e-3 of the sum.
    EXPECT_NEAR(crossing / sums.longitudinal_spherical(), 1, 5e-3) << name;
  }
}

TEST(Aberrations, DistortionIsTheLimitOfTheTracedChiefRay) {
  for (const char* name : kEyes) {
    const double y = 0.1 * kMm;
    const System eye = small(name, 0.05 * kMm);
    const Aberrations sums = third_order_aberrations(eye, y);
    const double z = eye.vertex(eye.size()) + sums.image_distance;
    const auto ray = at_image(eye, y, chief_slope(eye, y), z);
    ASSERT_TRUE(ray);
    const double error = ((*ray)[0] - sums.image_height) * (sums.image_height < 0 ? -1 : 1);
    EXPECT_NEAR(error / std::abs(sums.distortion_height()), sums.distortion_height() < 0 ? -1 : 1,
                5e-3)
        << name;  // fifth order: the field squared
  }
}

TEST(Aberrations, FieldCurvatureIsTheLimitOfCloseRaysAboutTheChiefRay) {
  for (const char* name : kEyes) {
    const double y = 0.1 * kMm, spread = 1e-6;
    const System eye = small(name, 0.05 * kMm);
    const Aberrations sums = third_order_aberrations(eye, y);
    const double z = eye.vertex(eye.size()) + sums.image_distance;
    const double chief = chief_slope(eye, y);
    const auto low = at_image(eye, y, chief - spread, z),
               high = at_image(eye, y, chief + spread, z);
    ASSERT_TRUE(low && high);
    const double tangential = -((*high)[0] - (*low)[0]) / ((*high)[1] - (*low)[1]);
    EXPECT_NEAR(tangential / sums.tangential_field(), 1, 1e-2)
        << name;  // differences of 1e-12 m of 1e-6 slopes
    const auto skew =
        trace_out(open(eye), {{y, 0, 0}, Eigen::Vector3d(chief, spread, 1).normalized()}).ray;
    const double sagittal =
        skew.origin.z() - skew.origin.y() * skew.direction.z() / skew.direction.y() - z;
    EXPECT_NEAR(sagittal / sums.sagittal_field(), 1, 1e-2) << name;
  }
}

TEST(Aberrations, ComaIsTheLimitOfThreeMeridionalRays) {
  for (const char* name : kEyes) {
    const double y = 0.05 * kMm;
    const System eye = small(name, 0.05 * kMm);
    const Aberrations sums = third_order_aberrations(eye, y);
    const double z = eye.vertex(eye.size()) + sums.image_distance;
    const double chief = chief_slope(eye, y), half = slope_to_stop(eye, 0, eye.stop->radius);
    const auto low = at_image(eye, y, chief - half, z), middle = at_image(eye, y, chief, z),
               high = at_image(eye, y, chief + half, z);
    ASSERT_TRUE(low && middle && high);
    const double coma = ((*low)[0] + (*high)[0]) / 2 - (*middle)[0];
    const double expected = 3 * sums.total.coma / (2 * sums.marginal_slope);
    EXPECT_NEAR(coma / expected, 1, 2e-2)
        << name;  // the pupil's own aberration displaces the rays' pupil heights
  }
}

TEST(Aberrations, ThePetzvalSumIsThatOfPowersOverIndices) {
  const System eye = prescription("navarro_condensing").system;
  const Aberrations sums = third_order_aberrations(eye, 1 * kMm);
  double petzval = 0;
  for (int i = 1; i < eye.size(); ++i) {
    const double n = eye.surfaces[i - 1].index, m = eye.surfaces[i].index;
    petzval += (m - n) / (eye.surfaces[i].radius * n * m);
  }
  EXPECT_NEAR(sums.petzval_curvature, -petzval, 1e-10);
  const double sag = sums.petzval_curvature * sums.image_height * sums.image_height / 2;
  EXPECT_NEAR(-sums.total.petzval / (2 * sums.marginal_slope * sums.marginal_slope), sag,
              std::abs(sag) * 1e-12);
}

TEST(Aberrations, AnAplanaticSphereHasNone) {
  // Object at the aplanatic point of a sphere: R (n + n') / n before the vertex... in glass, light
  // into air.
  const double n = 1.5, R = -10 * kMm;
  System lens = one_surface(R, 0, n, 1, -R * (1 + 1 / n));
  lens.stop = Stop{2, 3 * kMm};
  const Aberrations sums = third_order_aberrations(lens, 1 * kMm);
  EXPECT_NEAR(sums.total.spherical, 0, 1e-18);
  EXPECT_NEAR(sums.total.coma, 0, 1e-18);
  EXPECT_NEAR(sums.total.astigmatism, 0, 1e-18);
}

TEST(Aberrations, RefusesWhatHasNoStopOrNoImage) {
  System eye = prescription("navarro_condensing").system;
  expect_refused("object_height", [&] { (void)third_order_aberrations(eye, std::nan("")); });
  expect_refused("depth", [&] { (void)third_order_aberrations(eye, 1e-3, 0.1); });
  eye.stop.reset();
  expect_refused("stop", [&] { (void)third_order_aberrations(eye, 1e-3); });
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
