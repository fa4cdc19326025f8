// The ellipse of a spheroid against a conic through its tangent lines, and the localization from it
// against differences of that ellipse: minimum of (5.15), covariances and sensitivities.
// SPDX-License-Identifier: Apache-2.0
#include "optics/pose/pose.h"
#include "tests/optics/conicoid_reference.h"

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/QR>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <utility>
#include <vector>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

PoseSettings settings(bool linear = false) {
  PoseSettings s;
  s.projection.viewpoint = 17.2e-3;
  s.projection.slope_from_m = {linear ? 0 : 2.3e5, linear ? 0 : 700.0, 63.0, 0};
  s.projection.max_m = 6.5e-3;
  s.projection.max_z = 15e-3;
  s.projection.axis_m = {0.21e-3, -0.13e-3};
  s.image.pixel = 9.7e-6;
  s.image.center_px = {612.3, 488.9};
  s.robot.semi_axis = 0.93e-3;
  s.robot.semi_radius = 0.41e-3;
  s.angle_weight = 0.23;
  s.contour_points = 40;
  s.max_residual_px = 5;
  return s;
}

/// The image of what lies in a direction from the viewpoint, (5.2) by bisection.
Vector2d pixel_along(const PoseSettings& s, const Vector3d& direction) {
  const Vector2d across = direction.head<2>() / -direction.z();
  const auto& [a, b, c, d] = s.projection.slope_from_m;
  double low = 0;
  double high = s.projection.max_m;
  for (int i = 0; i < 200; ++i) {
    const double h = (low + high) / 2;
    (h * (c + h * (b + h * a)) + d < across.norm() ? low : high) = h;
  }
  const Vector2d m = -across.normalized() * low + s.projection.axis_m;
  return {s.image.center_px.x() - m.x() / s.image.pixel,
          s.image.center_px.y() + m.y() / s.image.pixel};
}

/// Whether a line through `at` along `direction` meets the spheroid: the discriminant.
bool meets(const Spheroid& robot, const Vector3d& center, const Vector3d& axis, const Vector3d& at,
           const Vector3d& direction) {
  const Vector3d n = axis.normalized();
  const auto over = [&](const Vector3d& v) -> Vector3d {
    const Vector3d along = n * n.dot(v);
    return along / robot.semi_axis + (v - along) / robot.semi_radius;
  };
  const Vector3d p = over(at - center);
  const Vector3d q = over(direction);
  return p.dot(q) * p.dot(q) > q.squaredNorm() * (p.squaredNorm() - 1);
}

/// The conic through many points, as center, semi-axes and angle: linear least squares.
EllipseVector conic(const std::vector<Vector2d>& points) {
  Vector2d mean(0, 0);
  for (const Vector2d& p : points) mean += p / double(points.size());
  const double unit = (points[0] - mean).norm();
  Eigen::MatrixXd rows(points.size(), 5);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vector2d q = (points[i] - mean) / unit;
    rows.row(i) << q.x() * q.x(), 2 * q.x() * q.y(), q.y() * q.y(), 2 * q.x(), 2 * q.y();
  }
  const Eigen::VectorXd k =
      rows.colPivHouseholderQr().solve(Eigen::VectorXd::Ones(rows.rows())).eval();
  Eigen::Matrix2d a;
  a << k[0], k[1], k[1], k[2];
  const Vector2d center = -a.inverse() * Vector2d(k[3], k[4]);
  const double level = 1 + center.dot(a * center);
  const double middle = (k[0] + k[2]) / 2;
  const double half = std::hypot((k[0] - k[2]) / 2, k[1]);
  EllipseVector e;
  e << mean + unit * center, unit * std::sqrt(level / (middle - half)),
      unit * std::sqrt(level / (middle + half)), std::atan2(-k[1], (k[2] - k[0]) / 2) / 2;
  return e;
}

/// The outline in the image, seen from the viewpoint.
EllipseVector outline(const PoseSettings& s, const Vector3d& position, const Vector3d& axis) {
  const Vector3d from(0, 0, s.projection.viewpoint);
  const Vector3d middle = (position - from).normalized();
  const Vector3d e1 = middle.unitOrthogonal();
  const Vector3d e2 = middle.cross(e1);
  std::vector<Vector2d> points;
  for (int i = 0; i < 180; ++i) {
    const double psi = i * std::numbers::pi / 90;
    const Vector3d side = e1 * std::cos(psi) + e2 * std::sin(psi);
    double low = 0;
    double high = 0.7;
    for (int n = 0; n < 60; ++n) {
      const double t = (low + high) / 2;
      (meets(s.robot, position, axis, from, middle * std::cos(t) + side * std::sin(t)) ? low
                                                                                       : high) = t;
    }
    points.push_back(pixel_along(s, middle * std::cos(low) + side * std::sin(low)));
  }
  return conic(points);
}

const std::vector<std::pair<Vector3d, Vector3d>> kPoses{
    {{2.1e-3, 1.3e-3, 3.9e-3}, {0.7, 0.4, -0.3}},  {{-1.7e-3, 0.9e-3, 5.2e-3}, {-0.2, 1.4, 0.5}},
    {{-0.6e-3, -2.2e-3, 2.8e-3}, {3, -2, 1}},      {{1.4e-3, -1.9e-3, 7.1e-3}, {0.1, 0.2, 0.9}},
    {{0.2e-3, -0.1e-3, 6e-3}, {-0.9, -0.25, 0.1}}, {{-2.4e-3, 1e-4, 4.4e-3}, {0.02, -1, 0.05}}};

double turn(double angle) { return std::remainder(angle, std::numbers::pi); }

TEST(PoseReference, shows_the_conic_through_the_tangent_lines) {
  for (const bool linear : {true, false}) {
    for (const auto& [position, axis] : kPoses) {
      for (const double stretch : {1.0, 0.3}) {  // longer and shorter along the axis than across
        PoseSettings s = settings(linear);
        s.robot.semi_axis *= stretch;
        s.robot.semi_axis /= linear ? 6 : 3;
        s.robot.semi_radius /= linear ? 6 : 3;
        const EllipseVector mine = outline(s, position, axis);
        const auto shown = project_spheroid(s, position, axis);
        ASSERT_TRUE(shown);
        // where slopes grow in proportion to m the outline is a conic, else fits differ a little
        const double error = linear ? 3e-4 : 0.02;
        for (int i = 0; i < 4; ++i) {
          EXPECT_NEAR((*shown)[i], mine[i], error) << i << " " << position.transpose();
        }
        EXPECT_LT(std::abs(turn((*shown)[4] - mine[4])) * (mine[2] - mine[3]), error);
        EXPECT_GT((*shown)[4], -std::numbers::pi / 2);
        EXPECT_LE((*shown)[4], std::numbers::pi / 2);
        for (const double length : {-1.0, 0.01, -250.0}) {  // any length, either sense
          const auto same = project_spheroid(s, position, length * axis);
          ASSERT_TRUE(same);
          EXPECT_LT((*same - *shown).norm(), 1e-9);
        }
      }
    }
  }
}

TEST(PoseReference, sees_along_the_lines_of_a_tilted_microscope) {
  const System eye = reference::spheres();
  Microscope m;
  m.focus = 11e-3;
  m.pupil_distance = 130e-3;
  m.decenter = {0.2e-3, -0.35e-3};
  m.tilt = {0.02, -0.03};
  PoseSettings s = settings();
  s.projection.viewpoint = 1;  // not used
  s.exact.emplace(eye, m, 4e-3);
  s.robot = {0.3e-3, 0.15e-3};
  for (const auto& [position, axis] :
       {std::pair{Vector3d(1.1e-3, 0.8e-3, 4e-3), Vector3d(0.6, -0.5, 0.3)},
        std::pair{Vector3d(-0.9e-3, 1.2e-3, 6e-3), Vector3d(0.2, 0.9, -0.6)}}) {
    const Vector2d middle = *s.exact->project(position);
    std::vector<Vector2d> points;
    for (int i = 0; i < 72; ++i) {
      const double psi = i * std::numbers::pi / 36;
      double low = 0;
      double high = 1.5e-3;
      for (int n = 0; n < 45; ++n) {
        const double r = (low + high) / 2;
        const auto line =
            reference::isopixel(eye, m, middle + r * Vector2d(std::cos(psi), std::sin(psi)));
        (line && meets(s.robot, position, axis, line->at, line->along) ? low : high) = r;
      }
      const Vector2d at = middle + low * Vector2d(std::cos(psi), std::sin(psi));
      points.push_back(s.image.center_px + Vector2d(-at.x(), at.y()) / s.image.pixel);
    }
    const EllipseVector mine = conic(points);
    const auto shown = project_spheroid(s, position, axis);
    ASSERT_TRUE(shown);
    for (int i = 0; i < 4; ++i) EXPECT_NEAR((*shown)[i], mine[i], 0.03) << i;
    EXPECT_LT(std::abs(turn((*shown)[4] - mine[4])) * (mine[2] - mine[3]), 0.03);
    const auto found = locate(s, *shown, EllipseCovariance::Identity(), axis,
                              position + Vector3d(2e-4, -3e-4, 5e-4));
    ASSERT_TRUE(found);
    EXPECT_LT((found->position_in_eye - position).norm(), 1e-8);
  }
}

/// The terms of (5.15); the half difference of the axes, which the angle counts by, is the shown
/// ellipse's.
EllipseVector terms(const PoseSettings& s, const EllipseVector& shown, const EllipseVector& seen) {
  EllipseVector t = shown - seen;
  t[4] = s.angle_weight * (shown[2] - shown[3]) / 2 * turn(shown[4] - seen[4]);
  return t;
}
EllipseVector terms_at(const PoseSettings& s, const Vector3d& position, const Vector3d& axis,
                       const EllipseVector& seen) {
  return terms(s, *project_spheroid(s, position, axis), seen);
}

using Derivative = Eigen::Matrix<double, 5, 3>;
Derivative by_position(const std::function<EllipseVector(const Vector3d&)>& f, const Vector3d& x) {
  Derivative j;
  for (int k = 0; k < 3; ++k) {
    const Vector3d h = 2e-6 * Vector3d::Unit(k);
    j.col(k) = (8 * (f(x + h) - f(x - h)) - (f(x + 2 * h) - f(x - 2 * h))) / 12 / 2e-6;
  }
  return j;
}

EllipseCovariance covariance() {
  EllipseCovariance root;
  root << 0.31, 0, 0, 0, 0, 0.05, 0.27, 0, 0, 0, -0.04, 0.03, 0.22, 0, 0, 0.02, -0.06, 0.07, 0.19,
      0, 0.001, -0.002, 0.003, 0.0015, 0.009;
  return root * root.transpose();
}
const EllipseVector kNoise = (EllipseVector() << 0.7, -0.5, 1.1, -0.8, 0.05).finished();

TEST(PoseReference, finds_the_least_of_5_15_with_its_covariance) {
  for (const auto& [position, axis] : kPoses) {
    const PoseSettings s = settings();
    const EllipseVector seen = *project_spheroid(s, position, axis) + kNoise;
    const auto found =
        locate(s, seen, covariance(), 3 * axis, position + Vector3d(3e-4, -2e-4, 6e-4));
    ASSERT_TRUE(found) << position.transpose();
    const Vector3d at = found->position_in_eye;
    const auto f = [&](const Vector3d& x) { return terms_at(s, x, axis, seen); };
    const EllipseVector left = f(at);
    EXPECT_NEAR(found->residual_px, std::sqrt(left.squaredNorm() / 5), 1e-7);
    EXPECT_GT(found->residual_px, 0.1);
    EXPECT_GT(found->iterations, 0);
    const Derivative j = by_position(f, at);
    const Matrix3d inverse = (j.transpose() * j).inverse();
    EXPECT_LT((inverse * (j.transpose() * left)).norm(), 2e-8) << "a step to the minimum";
    // each term moves by -1 with what was seen, the angle's by its factor
    EllipseCovariance c = covariance();
    const EllipseVector shown = *project_spheroid(s, at, axis);
    const double factor = s.angle_weight * (shown[2] - shown[3]) / 2;
    c.row(4) *= factor;
    c.col(4) *= factor;
    const Matrix3d expected = inverse * j.transpose() * c * j * inverse;
    EXPECT_LT((found->covariance - expected).norm(), 1e-3 * expected.norm());
    EXPECT_LT((found->covariance - found->covariance.transpose()).norm(), 1e-12 * expected.norm());
    // of an ellipse whose direction alone is uncertain
    EllipseCovariance turned = EllipseCovariance::Zero();
    turned(4, 4) = 0.04;
    const auto by_angle = locate(s, seen, turned, 3 * axis, position + Vector3d(3e-4, -2e-4, 6e-4));
    ASSERT_TRUE(by_angle);
    turned(4, 4) *= factor * factor;
    const Matrix3d alone = inverse * j.transpose() * turned * j * inverse;
    EXPECT_LT((by_angle->covariance - alone).norm(), 2e-3 * alone.norm());
  }
}

TEST(PoseReference, weighs_by_the_covariance_when_told_to) {
  for (const auto& [position, axis] : kPoses) {
    PoseSettings s = settings();
    s.weighted = true;
    const EllipseVector seen = *project_spheroid(s, position, axis) + kNoise;
    const EllipseCovariance given = covariance();
    const auto found = locate(s, seen, given, axis, position + Vector3d(-3e-4, 2e-4, -5e-4));
    ASSERT_TRUE(found);
    // e = (u, v, mean, along, across) about the seen angle; across is twice d times the angle
    const double d = (seen[2] - seen[3]) / 2;
    EllipseCovariance to = EllipseCovariance::Identity();
    to.row(2) << 0, 0, 0.5, 0.5, 0;
    to.row(3) << 0, 0, 0.5, -0.5, 0;
    to.row(4) << 0, 0, 0, 0, 2 * d;
    const EllipseCovariance weight = (to * given * to.transpose()).inverse();
    const auto f = [&](const Vector3d& x) {
      const EllipseVector e = *project_spheroid(s, x, axis);
      const double half = (e[2] - e[3]) / 2;
      EllipseVector smooth;
      smooth << e[0] - seen[0], e[1] - seen[1], (e[2] + e[3] - seen[2] - seen[3]) / 2,
          half * std::cos(2 * (e[4] - seen[4])) - d, half * std::sin(2 * (e[4] - seen[4]));
      return smooth;
    };
    ASSERT_GT(d, 3 * std::sqrt((to * given * to.transpose())(3, 3)));
    const Derivative j = by_position(f, found->position_in_eye);
    const Matrix3d expected = (j.transpose() * weight * j).inverse();
    EXPECT_LT((expected * (j.transpose() * weight * f(found->position_in_eye))).norm(), 3e-8);
    EXPECT_LT((found->covariance - expected).norm(), 1e-3 * expected.norm());
    // what is left is told in px, by the terms of (5.15)
    const EllipseVector left = terms_at(s, found->position_in_eye, axis, seen);
    EXPECT_NEAR(found->residual_px, std::sqrt(left.squaredNorm() / 5), 1e-7);
    // the weight of (5.15) has no part in it
    s.angle_weight = 5;
    const auto same = locate(s, seen, given, axis, position + Vector3d(-3e-4, 2e-4, -5e-4));
    ASSERT_TRUE(same);
    EXPECT_EQ(same->position_in_eye, found->position_in_eye);
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
