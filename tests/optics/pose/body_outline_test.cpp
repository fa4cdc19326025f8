// Outlines of bodies of convex parts: against dense samples of the surface, and their derivatives
// against differences.
// SPDX-License-Identifier: Apache-2.0
#include "optics/pose/body_outline.h"

#include "optics/pose/object_pose.h"
#include "tests/optics/pose/pose_support.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

namespace vitreo::optics {
namespace {

using detail::BodyState;
using Vector = Eigen::Vector3d;

const Vector kPlace(2 * kMm, 1 * kMm, 5 * kMm);
const ObjectModel kSpheroid = ellipsoid({0.5 * kMm, 0.5 * kMm, 1 * kMm});
const ObjectModel kRod = cylinder(1 * kMm, 0.25 * kMm);
const ObjectModel kDisc = cylinder(0.1 * kMm, 0.6 * kMm);
const ObjectModel kPlates = crossed_plates(1 * kMm, 0.5 * kMm, 42 * kUm);
const ObjectModel kRounded = crossed_plates(1 * kMm, 0.5 * kMm, 42 * kUm, true);
const ObjectModel kPin = disc_with_needle(0.5 * kMm, 0.1 * kMm, 1 * kMm, 0.08 * kMm);
const std::vector<ObjectModel> kBodies{kSpheroid, kRod, kDisc, kPlates, kRounded, kPin};

ObjectPoseSettings settings_of(const ObjectModel& object, bool exact = true) {
  static const ExactProjection projection(model_eye_5_3(), Microscope{}, 8 * kMm);
  static const PoseSettings shared = default_settings();
  ObjectPoseSettings settings;
  settings.projection = shared.projection;
  settings.image = shared.image;
  if (exact) settings.exact = projection;
  settings.object = object;
  return settings;
}

Eigen::Matrix3d turned(const Vector& by) {
  return by.norm() > 0 ? Eigen::AngleAxisd(by.norm(), by.normalized()).toRotationMatrix()
                       : Eigen::Matrix3d::Identity().eval();
}

const std::vector<BodyState> kStates{
    {kPlace, orientation_along(kOblique) * turned({0, 0, 0.4}), 1},
    {{-1 * kMm, 2 * kMm, 3 * kMm}, orientation_along({1, 0.03, 0.04}) * turned({0, 0, 0.2}), 1.1},
    {{0.5 * kMm, -0.3 * kMm, 7 * kMm}, orientation_along({0.1, 0.25, 1}) * turned({0, 0, 1}), 0.9},
    {{3 * kMm, 0.2 * kMm, 4 * kMm}, orientation_along({1, 0.4, -0.3}), 1}};

/// Points of a part's surface, on a lattice of some micrometers that has its edges.
std::vector<Vector> surface_of(const BodyPart& part, int steps = 240) {
  std::vector<Vector> unit;
  for (int i = 0; i < 2 * steps; ++i) {
    const double angle = std::numbers::pi * i / steps;
    const Vector level(std::cos(angle), std::sin(angle), 0);
    for (int j = 0; j <= steps; ++j) {
      const double t = 2.0 * j / steps - 1;
      if (part.kind == BodyPart::Kind::ball) {
        const double polar = std::numbers::pi / 2 * t;
        unit.push_back(std::cos(polar) * level + std::sin(polar) * Vector::UnitZ());
        continue;
      }
      unit.push_back(level + t * Vector::UnitZ());
      for (const double end : {-1, 1}) unit.push_back((t + 1) / 2 * level + end * Vector::UnitZ());
    }
  }
  for (Vector& p : unit) p = part.center + part.orientation * p.cwiseProduct(part.semi_axes);
  return unit;
}

TEST(BodyPart, IsTouchedAlsoSeenEndOnAndThroughItsMiddle) {
  const BodyPart rod{BodyPart::Kind::cylinder, {1, 1, 2}};
  EXPECT_NEAR(detail::touch(rod, {3, 4, 0}, {0, 0, 1}).gauge, 5, 1e-12);
  EXPECT_NEAR(detail::touch(rod, {3, 0, 0}, {0, 1, 0}).gauge, 3, 1e-12);
  EXPECT_NEAR(detail::touch(rod, {0, 0, 6}, {1, 0, 0}).gauge, 3, 1e-12);
  for (const Vector& along : {Vector(0, 0, 1), Vector(1, 0, 0), Vector(1, 2, 3)}) {
    for (const auto kind : {BodyPart::Kind::ball, BodyPart::Kind::cylinder}) {
      const auto touched = detail::touch({kind, {1, 1, 2}}, {0, 0, 0}, along);
      EXPECT_EQ(touched.gauge, 0);
      EXPECT_TRUE(touched.normal.allFinite() && touched.point.allFinite() && touched.support > 0);
    }
  }
}

/// Both ways: no sampled point of the surface is shown outside of the outline, and at each point of
/// the outline there is one.
TEST(BodyOutline, IsTheHullOfTheSampledSurfacesImages) {
  for (const bool exact : {true, false}) {
    for (const ObjectModel& body : kBodies) {
      const ObjectPoseSettings settings = settings_of(body, exact);
      const detail::ProjectionModel camera(settings.projection, settings.exact, settings.image);
      const auto parts = detail::convex_parts(body);
      for (const BodyState& state : kStates) {
        std::vector<Eigen::Vector2d> shown;
        for (const BodyPart& part : parts) {
          for (const Vector& p : surface_of(part)) {
            shown.push_back(*camera.pixel(state.position + state.orientation * (state.scale * p)));
          }
        }
        detail::IsopixelLine line;
        double most = -1;
        for (std::size_t i = 0; i < shown.size(); i += 7) {
          ASSERT_TRUE(camera.sight(shown[i], line));
          most = std::max(most, detail::outline_distance(parts, state, line).px);
        }
        EXPECT_LT(most, 1e-5);
        const auto outline = detail::outline_points(parts, camera, state, 40);
        ASSERT_TRUE(outline);
        for (const Eigen::Vector2d& rim : *outline) {
          double nearest = 1e9;
          for (const auto& pixel : shown) nearest = std::min(nearest, (pixel - rim).squaredNorm());
          EXPECT_LT(std::sqrt(nearest),
                    0.6);  // px: half the lattice's diagonal on the largest part
        }
      }
    }
  }
}

TEST(BodyOutline, DerivativesAreWhatDifferencesGive) {
  constexpr double kSteps[7] = {1e-7, 1e-7, 1e-7, 1e-5, 1e-5, 1e-5, 1e-5};
  for (const bool exact : {true, false}) {
    for (const ObjectModel& body : kBodies) {
      const ObjectPoseSettings settings = settings_of(body, exact);
      const detail::ProjectionModel camera(settings.projection, settings.exact, settings.image);
      const auto parts = detail::convex_parts(body);
      for (const BodyState& state : kStates) {
        const auto ellipse = detail::outline_ellipse(parts, camera, state, 64);
        const auto outline = detail::outline_points(parts, camera, state, 24);
        ASSERT_TRUE(ellipse && outline);
        for (int i = 0; i < 7; ++i) {
          Eigen::VectorXd step = Eigen::VectorXd::Zero(7);
          step[i] = kSteps[i];
          const BodyState more = detail::moved(state, {0, 1, 2, 3, 4, 5, 6}, step);
          const BodyState less = detail::moved(state, {0, 1, 2, 3, 4, 5, 6}, -step);
          const detail::SmoothEllipse change =
              (detail::outline_ellipse(parts, camera, more, 64)->ellipse -
               detail::outline_ellipse(parts, camera, less, 64)->ellipse) /
              (2 * kSteps[i]);
          const double scale = 1e-4 * (1 + ellipse->per_state.col(i).norm());
          EXPECT_LT((change - ellipse->per_state.col(i)).norm(), scale) << i;
          for (const Eigen::Vector2d& rim : *outline) {
            detail::IsopixelLine line;
            ASSERT_TRUE(camera.sight(rim + Eigen::Vector2d(0.3, -0.2), line));
            const auto here = detail::touch_outline(parts, state, line);
            const double by = (detail::touch_outline(parts, more, line).excess -
                               detail::touch_outline(parts, less, line).excess) /
                              (2 * kSteps[i]);
            // Across a kink, where another part or the cap begins, a difference is a mean.
            EXPECT_NEAR(by, here.per_state[i], 2e-3 * (1 + here.per_state.norm())) << i;
          }
        }
        for (const Eigen::Vector2d& rim : *outline) {
          detail::IsopixelLine line, right, down;
          constexpr double kPixel = 1e-4;
          camera.sight(rim, line);
          camera.sight(rim + Eigen::Vector2d(kPixel, 0), right);
          camera.sight(rim + Eigen::Vector2d(0, kPixel), down);
          const auto here = detail::touch_outline(parts, state, line);
          const Eigen::Vector2d by(detail::touch_outline(parts, state, right).excess - here.excess,
                                   detail::touch_outline(parts, state, down).excess - here.excess);
          EXPECT_LT((by / kPixel - here.per_px).norm(), 2e-3 * here.per_px.norm());
        }
      }
    }
  }
}

}  // namespace
}  // namespace vitreo::optics
