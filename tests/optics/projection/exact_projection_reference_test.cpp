// ExactProjection against chief rays that are traced by a plain loop, for
// microscopes and systems with and without an axis of symmetry; its derivatives
// against differences of those rays. SPDX-License-Identifier: Apache-2.0
#include "optics/projection/exact_projection.h"
#include "tests/optics/conicoid_reference.h"

#include <ceres/jet.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

using Eigen::Matrix2d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using reference::Line;

constexpr double kMaxM = 3e-3;

Microscope microscope(double pupil, const Vector2d& decenter = {0, 0},
                      const Vector2d& tilt = {0, 0}) {
  Microscope m;
  m.numerical_aperture = 0.017;
  m.focus = 11.3e-3;
  m.pupil_distance = pupil;
  m.decenter = decenter;
  m.tilt = tilt;
  return m;
}

struct Case {
  const char* name;
  System system;
  Microscope microscope;
  bool tabulated;
  bool symmetric;
  double error;  // m; allowed beside the trace
  ExactProjection projection{system, microscope, kMaxM, tabulated};
};

/// The same eye with a lens that has slipped and a condensing lens that leans.
System slipped() {
  System system = reference::spheres();
  for (int i : {1, 2}) system.surfaces[i].placement.decenter = {0.31e-3, -0.17e-3, 0};
  system.surfaces[5].placement.tilt = {0.04, -0.025, 0};
  system.surfaces[6].placement.tilt = {-0.02, 0.03, 0};
  system.surfaces[6].placement.decenter = {-0.2e-3, 0.1e-3, 0.05e-3};
  return system;
}
/// The eye with surfaces that are no spheres.
System conics() {
  System system = reference::spheres();
  system.surfaces[1].conic = -0.7;
  system.surfaces[2].conic = 1.9;
  system.surfaces[4].conic = -1.3;
  system.surfaces[5].conic = -3.1;
  system.surfaces[6].conic = -0.9;
  return system;
}

const std::vector<Case>& cases() {
  const double far = std::numeric_limits<double>::infinity();
  const Vector2d off(0.43e-3, -0.71e-3);
  const Vector2d tilt(0.03, -0.055);
  const System eye = reference::spheres();
  static const std::vector<Case> all{
      {"telecentric", eye, microscope(far), false, true, 1e-13},
      {"pupil before it", eye, microscope(90e-3), false, true, 1e-13},
      {"pupil on the eye's side", eye, microscope(-60e-3), false, true, 1e-13},
      {"conics", conics(), microscope(150e-3), false, true, 1e-13},
      {"decentered, telecentric", eye, microscope(far, off), false, true, 1e-13},
      {"the same, tabulated", eye, microscope(far, off), true, false, 4e-9},
      {"decentered, with a pupil", eye, microscope(80e-3, off), false, false, 4e-9},
      {"tilted, telecentric", eye, microscope(far, {0, 0}, tilt), false, false, 4e-9},
      {"tilted about x alone", eye, microscope(120e-3, {0, 0}, {0.06, 0}), false, false, 4e-9},
      {"tilted about y alone", eye, microscope(far, {0, 0}, {0, 0.06}), false, false, 4e-9},
      {"tilted and decentered", eye, microscope(-75e-3, off, tilt), false, false, 4e-9},
      {"slipped lens", slipped(), microscope(far), false, false, 4e-9},
      {"slipped lens, tilted", slipped(), microscope(110e-3, off, tilt), false, false, 4e-9},
  };
  return all;
}

/// Places in all quadrants, and on the microscope's axis; within 3 mm of either
/// axis.
const std::vector<Vector2d> kPlaces{{0, 0},
                                    {0.9e-3, 1.3e-3},
                                    {-1.7e-3, 0.6e-3},
                                    {-0.8e-3, -1.9e-3},
                                    {2.2e-3, -0.35e-3},
                                    {0.04e-3, -0.03e-3},
                                    {-1.21e-3, 0.13e-3}};

TEST(ExactProjectionReference, finds_the_place_whose_chief_ray_passes_the_point) {
  for (const Case& c : cases()) {
    SCOPED_TRACE(c.name);
    const ExactProjection& projection = c.projection;
    EXPECT_EQ(projection.symmetric(), c.symmetric);
    EXPECT_DOUBLE_EQ(projection.max_m(), kMaxM);
    EXPECT_LT(projection.max_residual(), c.error);
    for (const Vector2d& m : kPlaces) {
      const Line line = *reference::isopixel(c.system, c.microscope, m);
      for (const double z : {0.9e-3, 3.7e-3, 8.1e-3, 12.6e-3}) {
        const auto found = projection.project(line.at_z(z));
        ASSERT_TRUE(found) << m.transpose() << " at " << z;
        EXPECT_LT((*found - m).norm(), c.error) << m.transpose() << " at " << z;
        const auto more = projection.project_with_jacobian(line.at_z(z));
        ASSERT_TRUE(more);
        EXPECT_EQ(more->m, *found);
      }
    }
  }
}

TEST(ExactProjectionReference, states_an_error_that_holds_between_the_nodes) {
  for (const Case& c : cases()) {
    SCOPED_TRACE(c.name);
    const ExactProjection& projection = c.projection;
    if (c.symmetric) continue;  // only rounding
    double worst = 0;
    for (int i = 0; i < 400; ++i) {
      // a square is filled by two irrational steps
      const Vector2d m(2.7e-3 * (2 * std::fmod(0.31 + i * 0.7548776662466927, 1.0) - 1),
                       2.7e-3 * (2 * std::fmod(0.77 + i * 0.5698402909980532, 1.0) - 1));
      if ((m + c.microscope.decenter).norm() > 2.5e-3) continue;
      const Line line = *reference::isopixel(c.system, c.microscope, m);
      const auto found = projection.project(line.at_z(6e-3));
      ASSERT_TRUE(found) << m.transpose();
      worst = std::max(worst, (*found - m).norm());
    }
    EXPECT_LT(worst, 2 * projection.max_residual());
    EXPECT_GT(projection.max_residual(), 1e-13);
  }
}

/// The distance between a table's lines and those traced, in m of the aerial image, the largest of
/// places all over the table at both ends of the vitreous.
double residual_of(const ExactProjection& projection, const System& system, const Microscope& m) {
  double worst = 0;
  for (int i = 0; i < 3000; ++i) {
    // a square is filled by two irrational steps
    const Vector2d at =
        projection.max_m() * Vector2d(2 * std::fmod(0.31 + i * 0.7548776662466927, 1.0) - 1,
                                      2 * std::fmod(0.77 + i * 0.5698402909980532, 1.0) - 1);
    detail::IsopixelLine line;
    const auto traced = reference::isopixel(system, m, at);
    if (!traced || !projection.line(at, line)) continue;
    for (const double z : {0.0, projection.max_z()}) {
      const Vector2d off = line.at(z) - traced->at_z(z).head<2>();
      worst = std::max(worst, (line.per_m(z).inverse() * off).norm());
    }
  }
  return worst;
}

// A table that is coarse for its reach is worst in one corner: in each of the four, one after the
// other, so that a check which leaves a part of the table out is seen.
TEST(ExactProjectionReference, states_the_largest_error_wherever_in_the_table_it_is) {
  const System eye = reference::spheres();
  for (const Vector2d& tilt : {Vector2d(0.05, 0.05), Vector2d(-0.05, 0.05), Vector2d(0.05, -0.05),
                               Vector2d(-0.05, -0.05)}) {
    for (const double pupil : {60e-3, -60e-3}) {
      SCOPED_TRACE(::testing::Message() << tilt.transpose() << ", pupil at " << pupil);
      const Microscope m = microscope(pupil, {0, 0}, tilt);
      const ExactProjection projection(eye, m, 6e-3);
      const double worst = residual_of(projection, eye, m);
      ASSERT_GT(worst, 1e-10);
      EXPECT_GT(projection.max_residual(), 0.5 * worst);
      EXPECT_LT(projection.max_residual(), 1.2 * worst);
    }
  }
  // far out the polynomials of a symmetric chain have an error that is more than rounding
  for (const double max_m : {10e-3, 11e-3, 12e-3}) {
    const Microscope m = microscope(150e-3);
    const ExactProjection projection(conics(), m, max_m);
    const double worst = residual_of(projection, conics(), m);
    ASSERT_GT(worst, 1e-10);
    EXPECT_GT(projection.max_residual(), 0.8 * worst);
    EXPECT_LT(projection.max_residual(), 1.2 * worst);
  }
}

TEST(ExactProjectionReference, gives_the_line_of_a_place_as_it_is_traced) {
  for (const Case& c : cases()) {
    SCOPED_TRACE(c.name);
    const ExactProjection& projection = c.projection;
    for (const Vector2d& m : kPlaces) {
      const Line traced = *reference::isopixel(c.system, c.microscope, m);
      for (const double z : {-2e-3, 0.0, 5.3e-3, 40e-3}) {
        const auto line = projection.line(m, z);
        ASSERT_TRUE(line);
        EXPECT_DOUBLE_EQ(line->origin.z(), z);
        EXPECT_LT((line->origin - traced.at_z(z)).norm(), 3 * c.error);
        EXPECT_NEAR(line->direction.norm(), 1, 1e-14);
        EXPECT_LT((line->direction - traced.along).norm(), 300 * c.error);
      }
      EXPECT_EQ(projection.line(m)->origin.z(), 0);
      detail::IsopixelLine line;
      ASSERT_TRUE(projection.line(m, line));
      EXPECT_LT((line.at_retina - traced.at_z(0).head<2>()).norm(), 3 * c.error);
      EXPECT_LT((line.slope - traced.slope()).norm(), 300 * c.error);
      const auto retina = reference::change_of(c.system, c.microscope, m, 0);
      // a cubic's derivative is known less well than its value, by the nodes'
      // distance of 75 um
      const double loose = 1e-9 + c.error / 20e-6;
      EXPECT_LT((line.at_retina_per_m - retina.at_z).norm(), loose) << m.transpose();
      EXPECT_LT((line.slope_per_m - retina.slope).norm(), 1e-7 + 200 * loose) << m.transpose();
      const auto far = reference::change_of(c.system, c.microscope, m, 7e-3);
      EXPECT_LT((line.per_m(7e-3) - far.at_z).norm(), 3 * loose);
    }
  }
}

TEST(ExactProjectionReference, has_the_derivative_of_the_traced_lines) {
  for (const Case& c : cases()) {
    SCOPED_TRACE(c.name);
    const ExactProjection& projection = c.projection;
    for (const Vector2d& m : kPlaces) {
      const Line traced = *reference::isopixel(c.system, c.microscope, m);
      const Vector3d point = traced.at_z(4.7e-3);
      const auto change = reference::change_of(c.system, c.microscope, m, point.z());
      const auto found = projection.project_with_jacobian(point);
      ASSERT_TRUE(found);
      // dx is what m moves the line by, less what it is moved by along its
      // slope
      const Matrix2d moved = change.at_z * found->per_point.leftCols<2>();
      EXPECT_LT((moved - Matrix2d::Identity()).norm(), 1e-8 + c.error / 10e-6) << m.transpose();
      EXPECT_LT((found->per_point * traced.along).norm(), 1e-9 + 1e3 * c.error) << m.transpose();
    }
  }
}

TEST(ExactProjectionReference, carries_the_derivatives_of_jets) {
  using Jet = ceres::Jet<double, 3>;
  for (const Case& c : cases()) {
    SCOPED_TRACE(c.name);
    const ExactProjection& projection = c.projection;
    for (const Vector2d& m : kPlaces) {
      const Vector3d at = reference::isopixel(c.system, c.microscope, m)->at_z(3.3e-3);
      detail::Vector3<Jet> point;
      for (int k = 0; k < 3; ++k) point[k] = Jet(at[k], k);
      detail::Vector2<Jet> image;
      ASSERT_TRUE(projection.project(point, image));
      const auto plain = projection.project_with_jacobian(at);
      detail::Vector2<double> value;
      ASSERT_TRUE(projection.project(at, value));
      for (int k = 0; k < 2; ++k) {
        EXPECT_NEAR(image[k].a, m[k], c.error);
        EXPECT_NEAR(value[k], plain->m[k], 1e-15);
        for (int j = 0; j < 3; ++j) {
          EXPECT_NEAR(image[k].v[j], plain->per_point(k, j), 1e-10 * plain->per_point.norm());
        }
      }
    }
  }
}

TEST(ExactProjectionReference, takes_the_viewpoint_half_way_between_the_foci) {
  using Jet = ceres::Jet<double, 3>;
  for (const Case& c : cases()) {
    SCOPED_TRACE(c.name);
    const ExactProjection& projection = c.projection;
    for (const Vector2d& m : kPlaces) {
      const double z = 4.1e-3;
      const Line line = *reference::isopixel(c.system, c.microscope, m);
      // The foci are where neighbors meet: the roots of det(dx/dm + w ds/dm),
      // by its value at three places.
      const auto change = reference::change_of(c.system, c.microscope, m, z);
      const double d0 = change.at_z.determinant();
      const double d2 = change.slope.determinant();
      const double d1 = (change.at_z + change.slope).determinant() - d0 - d2;
      // the sum of the roots' inverses is -d1 / d0
      const double power = -d1 / d0 / 2;
      Vector3d viewpoint;
      ASSERT_TRUE(projection.viewpoint_near(line.at_z(z), viewpoint));
      EXPECT_NEAR((viewpoint.z() - z) * power, 1, 1e-8 + c.error / 1e-6) << m.transpose();
      EXPECT_LT((viewpoint - line.at_z(viewpoint.z())).norm(), 1e-12 + 10 * c.error);
      // With the power held, it goes along with the point: the line's own place
      // and slope change.
      detail::Vector3<Jet> point;
      for (int k = 0; k < 3; ++k) point[k] = Jet(line.at_z(z)[k], k);
      detail::Vector3<Jet> seen;
      ASSERT_TRUE(projection.viewpoint_near(point, seen));
      const auto found = projection.project_with_jacobian(line.at_z(z));
      for (int j = 0; j < 3; ++j) {
        const Vector2d tilted = change.slope * found->per_point.col(j) / power;
        for (int k = 0; k < 2; ++k) {
          EXPECT_NEAR(seen[k].a, viewpoint[k], 1e-16);
          EXPECT_NEAR(seen[k].v[j], (k == j ? 1 : 0) + tilted[k], 1e-7 + c.error / 1e-6);
        }
        EXPECT_DOUBLE_EQ(seen.z().v[j], j == 2 ? 1 : 0);
      }
    }
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
