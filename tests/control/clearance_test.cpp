// Clearance of bodies against dense samples of their surfaces, and its uncertainty against bodies
// drawn from it.
// SPDX-License-Identifier: Apache-2.0
#include "control/clearance.h"

#include "control/robots.h"
#include "tests/control/surface_samples.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>
#include <vector>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

const EyeCavity kEye;
const samples::Eye kSampledEye;

UncertainPose pose_at(const Eigen::Vector3d& position, const Eigen::Vector3d& axis) {
  UncertainPose pose;
  pose.position = position;
  pose.axis = axis.normalized();
  pose.axis_sigma = 0;
  return pose;
}

samples::Points samples_of(const BodySurface& body) {
  switch (body.shape) {
    case BodyShape::cylinder:
    case BodyShape::disc:
      return samples::cylinder(body.semi_axis, body.semi_radius);
    default:
      return samples::spheroid(body.semi_axis, body.semi_radius);
  }
}

const std::vector<BodySurface> kBodies{{BodyShape::ellipsoid, 1e-3, 0.5e-3},
                                       {BodyShape::sphere, 0.25e-3, 0.25e-3},
                                       {BodyShape::cylinder, 0.5e-3, 0.25e-3},
                                       {BodyShape::disc, 0.1e-3, 0.6e-3}};

Eigen::Vector3d direction(std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  return Eigen::Vector3d(normal(random), normal(random), normal(random)).normalized();
}

Eigen::Vector3d place(std::mt19937_64& random) {
  std::uniform_real_distribution<double> aside(-9e-3, 9e-3);
  std::uniform_real_distribution<double> height(-4.8e-3, 10e-3);
  return {aside(random), aside(random), height(random)};
}

// Retinas drawn about the believed one: their depth along z, and their sag by the radius.
TEST(Clearance, HoldsWhereTheWallsAreNotWhereTheyAreBelieved) {
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  EyeCavity eye;
  eye.retina_sigma = 0.3e-3;
  eye.sag_sigma = 0.15e-3;
  eye.lens_sigma = 0.1e-3;
  const BodySurface body{BodyShape::sphere, 0.25e-3, 0.25e-3};
  for (const Eigen::Vector3d& at :
       {Eigen::Vector3d(0, 0, -3.5e-3), Eigen::Vector3d(3e-3, 0, -3e-3)}) {
    const Clearance shown = clearance(body, eye, pose_at(at, {1, 0, 0}));
    const Clearance sure = clearance(body, {}, pose_at(at, {1, 0, 0}));
    EXPECT_EQ(shown.retina.distance, sure.retina.distance);
    EXPECT_GT(shown.retina.uncertainty, 2.4 * 0.3e-3);
    EXPECT_NEAR(shown.lens.uncertainty, 2.58 * 0.1e-3, 1e-9);
    constexpr int kDraws = 4000;
    int nearer = 0;
    for (int k = 0; k < kDraws; ++k) {
      samples::Eye real;
      real.vertex.z() += 0.3e-3 * normal(random);
      // A retina whose radius is off by more is none (devices/sim/optics_sample).
      const double off = 2 * 0.15e-3 * normal(random) * std::pow(real.radius / 4e-3, 2);
      real.radius -= std::clamp(off, -0.3 * real.radius, 0.3 * real.radius);
      const double distance = samples::from_retina(real, at) - body.semi_radius;
      nearer += distance < shown.retina.bound();
    }
    // One in two hundred; the square root of 20 about it, and a radius that is not linear.
    EXPECT_LT(nearer, 36) << at.x();
    EXPECT_GT(nearer, 6) << at.x();
  }
}

TEST(Clearance, IsThatOfTheNearestSampleOfTheSurfaceWhateverShapePlaceAndAttitude) {
  std::mt19937_64 random(1);
  for (const BodySurface& body : kBodies) {
    const samples::Points surface = samples_of(body);
    for (int k = 0; k < 200; ++k) {
      const Eigen::Vector3d at = place(random);
      const Eigen::Vector3d axis = direction(random);
      const Clearance found = clearance(body, kEye, pose_at(at, axis));
      const samples::Least least = samples::least_distance(kSampledEye, surface, at, axis);
      // Samples lie at most 35 um apart: what is between two is nearer by up to a micrometer.
      EXPECT_NEAR(found.retina.distance, least.retina, 1e-6) << to_string(body.shape) << " " << k;
      EXPECT_LE(found.retina.distance, least.retina + 1e-9);
      EXPECT_NEAR(found.lens.distance, least.lens, 1e-6);
      EXPECT_LE(found.lens.distance, least.lens + 1e-9);
      EXPECT_LT(found.retina.uncertainty, 1e-12) << "all is known";
    }
  }
}

TEST(Clearance, OfARobotThatLiesOnTheRetinaIsNothingAndOfAnUprightOneLess) {
  const BodySurface body = surface_of(coni_2mm());
  // 0.5 mm is its half width: the review's robot that lay under "0.65 mm" for 25 s. A long body on
  // a hollow sphere touches with its middle while its ends stand clear.
  EXPECT_NEAR(clearance(body, kEye, pose_at({0, 0, -4.5e-3}, {1, 0, 0})).retina.distance, 0, 1e-9);
  EXPECT_NEAR(clearance(body, kEye, pose_at({0, 0, -4.5e-3}, {0, 0, 1})).retina.distance, -0.5e-3,
              1e-9);
  EXPECT_NEAR(clearance(body, kEye, pose_at({0, 0, -4e-3}, {0, 0, 1})).retina.distance, 0, 1e-9);
}

TEST(Clearance, OfCrossedPlatesIsThatOfTheirWorstRoll) {
  const BodySurface body = surface_of(coni_2mm());
  const Eigen::Vector3d at(2e-3, 1e-3, -3.5e-3);
  const Eigen::Vector3d axis = Eigen::Vector3d(1, 0.3, 0.2).normalized();
  const double found = clearance(body, kEye, pose_at(at, axis)).retina.distance;
  double least = 1;
  for (int k = 0; k < 90; ++k) {
    const double roll = k * M_PI / 180;
    const auto plates = samples::crossed_plates(1e-3, 0.5e-3, 42e-6, roll);
    const double one = samples::least_distance(kSampledEye, plates, at, axis).retina;
    EXPECT_GE(one, found - 1e-6) << "no roll comes nearer, but for the plates' edges";
    least = std::min(least, one);
  }
  EXPECT_NEAR(found, least, 2e-6) << "and one comes as near";
}

TEST(Clearance, GrowsAlongItsNormal) {
  std::mt19937_64 random(2);
  for (int k = 0; k < 100; ++k) {
    const BodySurface& body = kBodies[static_cast<std::size_t>(k) % kBodies.size()];
    const UncertainPose pose = pose_at(place(random), direction(random));
    const Clearance before = clearance(body, kEye, pose);
    UncertainPose moved = pose;
    moved.position += 1e-6 * before.retina.normal;
    EXPECT_NEAR(clearance(body, kEye, moved).retina.distance - before.retina.distance, 1e-6, 2e-8);
  }
}

// One-sided: of bodies drawn from position and attitude, 99.5 % or more are beyond the bound.
TEST(Clearance, ItsLowerBoundHoldsForBodiesDrawnFromWhatIsNotKnown) {
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  for (const BodySurface& body : kBodies) {
    for (const Eigen::Vector3d& axis :
         {Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(0, 0, 1), Eigen::Vector3d(1, 0, 1)}) {
      UncertainPose pose = pose_at({0.5e-3, 0, -3.5e-3}, axis);
      pose.axis_sigma = 0.08;
      pose.covariance = Eigen::Vector3d(10e-6, 10e-6, 40e-6).cwiseAbs2().asDiagonal();
      const double bound = clearance(body, kEye, pose).retina.bound();
      int below = 0;
      constexpr int kDrawn = 4000;
      for (int k = 0; k < kDrawn; ++k) {
        UncertainPose drawn = pose;
        drawn.axis_sigma = 0;
        drawn.covariance.setZero();
        drawn.position +=
            Eigen::Vector3d(10e-6 * normal(random), 10e-6 * normal(random), 40e-6 * normal(random));
        const Eigen::Vector3d side = pose.axis.unitOrthogonal();
        const Eigen::Vector3d tilt =
            pose.axis_sigma * (normal(random) * side + normal(random) * pose.axis.cross(side));
        drawn.axis = (pose.axis + tilt).normalized();
        if (clearance(body, kEye, drawn).retina.distance < bound) ++below;
      }
      EXPECT_LT(below, 0.005 * kDrawn + 4 * std::sqrt(0.005 * kDrawn))
          << to_string(body.shape) << " along " << axis.transpose();
    }
  }
}

TEST(Clearance, WithoutAKnownAttitudeTheWorstOneCounts) {
  UncertainPose pose;
  pose.position = {0, 0, -3.8e-3};
  const BodySurface robot = surface_of(coni_2mm());
  EXPECT_NEAR(clearance(robot, kEye, pose).retina.bound(), 0.2e-3, 1e-9) << "upright";
  const BodySurface magnet = surface_of(ndfeb_cylinder_1mm());
  EXPECT_EQ(magnet.shape, BodyShape::cylinder);
  EXPECT_NEAR(clearance(magnet, kEye, pose).retina.bound(), 1.2e-3 - std::hypot(0.5e-3, 0.25e-3),
              2e-6)
      << "on an edge";
}

TEST(Clearance, RefusesWhatIsNoPose) {
  const BodySurface body;
  UncertainPose pose = pose_at({0, 0, 0}, {1, 0, 0});
  pose.position.x() = NAN;
  EXPECT_THROW(clearance(body, kEye, pose), std::invalid_argument);
  pose = pose_at({0, 0, 0}, {1, 0, 0});
  pose.axis *= 2;
  EXPECT_THROW(clearance(body, kEye, pose), std::invalid_argument);
  EXPECT_THROW(clearance({BodyShape::disc, 0, 1e-3}, kEye, pose_at({0, 0, 0}, {1, 0, 0})),
               std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
