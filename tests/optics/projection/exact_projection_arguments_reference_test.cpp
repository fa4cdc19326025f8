// Where ExactProjection gives nothing: beyond the table, retina, lens, iris and
// crossings, each bound against rays that are traced by a plain loop; and what
// it refuses. SPDX-License-Identifier: Apache-2.0
#include "optics/projection/exact_projection.h"
#include "tests/optics/conicoid_reference.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <vector>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

using Eigen::Vector2d;
using Eigen::Vector3d;
using reference::Line;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kFar = std::numeric_limits<double>::infinity();

Microscope microscope(double pupil = kFar, const Vector2d& decenter = {0, 0},
                      const Vector2d& tilt = {0, 0}) {
  Microscope m;
  m.focus = 11.3e-3;
  m.pupil_distance = pupil;
  m.decenter = decenter;
  m.tilt = tilt;
  return m;
}
const std::vector<Microscope>& microscopes() {
  static const std::vector<Microscope> all{microscope(), microscope(kFar, {0.4e-3, -0.3e-3}),
                                           microscope(90e-3, {-0.2e-3, 0.3e-3}, {0.04, -0.03})};
  return all;
}

/// A retina that is no sphere, and a lens that is hollow towards it: off the
/// axis both are met elsewhere than at the vertex.
System hollow() {
  System system = reference::spheres();
  system.surfaces[0].conic = -0.45;
  system.surfaces[1].radius = -31e-3;
  system.surfaces[2].radius = -9e-3;
  return system;
}

Vector3d on(const System& system, int surface, const Line& line) {
  const Vector3d vertex(0, 0, reference::vertex_z(system, surface));
  return vertex + *reference::meet(system.surfaces[surface - 1], {line.at - vertex, line.along});
}

TEST(ExactProjectionBounds, reaches_from_the_retina_to_the_lens) {
  const System system = hollow();
  Microscope out = microscope(-60e-3);  // its lines do not cross in the vitreous
  for (const Microscope& tilted : {out, microscope(-70e-3, {0.2e-3, 0.1e-3}, {0.03, -0.02})}) {
    const ExactProjection projection(system, tilted, 2e-3);
    for (const Vector2d& m : {Vector2d(1.2e-3, -0.5e-3), Vector2d(-0.7e-3, 1.4e-3)}) {
      const Line line = *reference::isopixel(system, tilted, m);
      const Vector3d retina = on(system, 1, line);
      EXPECT_GT(retina.z(), 1e-5);
      const Vector3d lens = on(system, 2, line);
      EXPECT_LT(lens.z(), reference::vertex_z(system, 2) - 1e-6);
      ASSERT_GT(projection.max_z(), lens.z());
      EXPECT_TRUE(projection.project(line.at_z(retina.z() + 3e-9)));
      EXPECT_FALSE(projection.project(line.at_z(retina.z() - 3e-9)));
      EXPECT_TRUE(projection.project(line.at_z(lens.z() - 3e-9)));
      EXPECT_FALSE(projection.project(line.at_z(lens.z() + 3e-9)));
      EXPECT_TRUE(projection.project_with_jacobian(line.at_z(retina.z() + 3e-9)));
      EXPECT_FALSE(projection.project_with_jacobian(line.at_z(retina.z() - 3e-9)));
      EXPECT_TRUE(projection.project_with_jacobian(line.at_z(lens.z() - 3e-9)));
      EXPECT_FALSE(projection.project_with_jacobian(line.at_z(lens.z() + 3e-9)));
      // the silhouette's way is bounded by the table only
      for (const double z : {retina.z() - 1.5e-3, retina.z() - 3e-9, lens.z() + 3e-9}) {
        Vector2d image;
        ASSERT_TRUE(projection.project(detail::Vector3<double>(line.at_z(z)), image));
        EXPECT_LT((image - m).norm(), 1e-9);
      }
    }
    for (const double z : {-3e-9, 3e-9}) {  // on the axis
      EXPECT_EQ(projection.project({0, 0, z}).has_value(), z > 0);
      EXPECT_EQ(projection.project({0, 0, reference::vertex_z(system, 2) - z}).has_value(), z > 0);
    }
  }
}

TEST(ExactProjectionBounds, ends_before_lines_cross) {
  const System system = reference::spheres();
  for (const Microscope& m : microscopes()) {
    const ExactProjection projection(system, m, 2e-3);
    // the least z at which two neighbors of any line meet: det(dx/dm + w ds/dm) = 0
    double least = kFar;
    for (int i = -9; i <= 9; ++i) {
      for (int k = -9; k <= 9; ++k) {
        const Vector2d at = Vector2d(i, k) * 0.2e-3;
        if (m.tilt.isZero() && (at + m.decenter).norm() > 2e-3) continue;
        const auto change = reference::change_of(system, m, at, 0);
        const double d0 = change.at_z.determinant();
        const double d2 = change.slope.determinant();
        const double d1 = (change.at_z + change.slope).determinant() - d0 - d2;
        const double root = std::sqrt(std::max(0.0, d1 * d1 - 4 * d2 * d0));
        for (const double w : {(-d1 - root) / (2 * d2), (-d1 + root) / (2 * d2)}) {
          if (w > 0) least = std::min(least, w);
        }
      }
    }
    EXPECT_LT(projection.max_z(), least);
    EXPECT_GT(projection.max_z(), 0.93 * least);
    ASSERT_LT(projection.max_z(), reference::vertex_z(system, 2));
    for (const Vector2d& at : {Vector2d(0.7e-3, 0.4e-3), Vector2d(-0.3e-3, -1.1e-3)}) {
      const Line line = *reference::isopixel(system, m, at);
      Vector2d image;
      Vector3d viewpoint;
      const Vector3d before = line.at_z(projection.max_z() - 1e-9);
      const Vector3d behind = line.at_z(projection.max_z() + 1e-9);
      EXPECT_TRUE(projection.project(before));
      EXPECT_TRUE(projection.project_with_jacobian(before));
      EXPECT_TRUE(projection.project(detail::Vector3<double>(before), image));
      EXPECT_LT((image - at).norm(), 1e-8);
      EXPECT_TRUE(projection.viewpoint_near(detail::Vector3<double>(before), viewpoint));
      EXPECT_FALSE(projection.project(behind));
      EXPECT_FALSE(projection.project_with_jacobian(behind));
      EXPECT_FALSE(projection.project(detail::Vector3<double>(behind), image));
      EXPECT_FALSE(projection.viewpoint_near(detail::Vector3<double>(behind), viewpoint));
    }
  }
}

TEST(ExactProjectionBounds, reaches_as_far_as_the_vitreous_where_no_lines_cross) {
  const System system = reference::spheres();
  EXPECT_DOUBLE_EQ(ExactProjection(system, microscope(-60e-3), 2e-3).max_z(),
                   reference::vertex_z(system, 2));
}

TEST(ExactProjectionBounds, knows_no_viewpoint_where_lines_spread) {
  // lines that come from the eye's side meet behind the retina: there is no
  // power to speak of
  const System system = reference::spheres();
  const Microscope m = microscope(-4e-3);
  const Vector2d at(0.2e-3, -0.1e-3);
  const auto change = reference::change_of(system, m, at, 5e-3);
  const bool meet = (change.at_z.inverse() * change.slope).trace() < 0;
  const ExactProjection projection(system, m, 0.5e-3);
  const Vector3d point = reference::isopixel(system, m, at)->at_z(5e-3);
  ASSERT_TRUE(projection.project(point));
  EXPECT_FALSE(meet);
  Vector3d viewpoint;
  EXPECT_EQ(projection.viewpoint_near(point, viewpoint), meet);
}

TEST(ExactProjectionBounds, ends_with_its_table) {
  const System system = reference::spheres();
  const double max_m = 2.3e-3;
  const auto at = [&](const ExactProjection& projection, const Microscope& m, const Vector2d& place,
                      bool inside) {
    detail::IsopixelLine line;
    EXPECT_EQ(projection.line(place).has_value(), inside) << place.transpose();
    EXPECT_EQ(projection.line(place, line), inside);
    const Vector3d point = reference::isopixel(system, m, place)->at_z(6e-3);
    EXPECT_EQ(projection.project(point).has_value(), inside) << place.transpose();
    EXPECT_EQ(projection.project_with_jacobian(point).has_value(), inside);
    Vector2d image;
    EXPECT_EQ(projection.project(detail::Vector3<double>(point), image), inside);
  };
  const ExactProjection round(system, microscope(), max_m);
  const ExactProjection square(system, microscopes()[2], max_m);
  for (const double angle : {0.4, 2.0, 3.5, 5.9}) {
    const Vector2d u(std::cos(angle), std::sin(angle));
    at(round, microscope(), u * max_m * (1 - 1e-6), true);
    at(round, microscope(), u * max_m * (1 + 1e-6), false);
    const Vector2d corner = u / u.cwiseAbs().maxCoeff();
    at(square, microscopes()[2], corner * max_m * (1 - 1e-5), true);
    at(square, microscopes()[2], corner * max_m * (1 + 1e-5), false);
  }
  at(square, microscopes()[2], Vector2d(max_m, max_m) * (1 - 1e-5), true);
  at(square, microscopes()[2], Vector2d(-max_m, max_m) * (1 - 1e-5), true);
}

// A telecentric table counts |m| from the eye's axis: beside a decentered microscope 2 mm reach
// from -2.4 to 1.6 mm.
TEST(ExactProjectionBounds, are_about_the_eyes_axis_when_telecentric_and_decentered) {
  const ExactProjection projection(reference::spheres(), microscope(kFar, {0.4e-3, 0}), 2e-3);
  for (const auto& [x, there] : {std::pair(1.5e-3, true), {1.7e-3, false}, {-2.3e-3, true}})
    EXPECT_EQ(projection.line({x, 0.1e-3}).has_value(), there) << x;
  EXPECT_FALSE(projection.line({-2.5e-3, 0.1e-3}));
}
// Beside a lens that bulges towards the retina the vitreous ends at the lens' vertex.
TEST(ExactProjectionBounds, end_at_the_lens_vertex_beside_its_bulge) {
  const System system = reference::spheres();
  const ExactProjection projection(system, microscope(-60e-3), 2e-3);
  EXPECT_TRUE(projection.project({0.3e-3, 0, reference::vertex_z(system, 2) - 1e-7}));
  EXPECT_FALSE(projection.project({0.3e-3, 0, reference::vertex_z(system, 2) + 1e-6}));
}

TEST(ExactProjectionBounds, has_the_shadow_of_the_iris) {
  System system = reference::spheres();
  System open = system;
  open.stop.reset();
  const double asked = 3.5e-3;
  for (const Microscope& m : microscopes()) {
    system.stop->radius = m.tilt.isZero() ? 0.3e-3 : 0.9e-3;
    const ExactProjection projection(system, m, asked);
    const auto lit = [&](const Vector2d& at) {
      return reference::isopixel(system, m, at).has_value();
    };
    // what may be lost beside the shadow: one of the polynomials' samples, or nodes that a cubic
    // and its search take
    const double loss = projection.symmetric() ? asked / 40 : 6 * (2 * asked / 80);
    int inside = 0;
    int outside = 0;
    for (int i = -13; i <= 13; ++i) {
      for (int k = -13; k <= 13; ++k) {
        const Vector2d at = Vector2d(i, k) * 0.25e-3 - m.decenter;
        bool around = lit(at) && at.cwiseAbs().maxCoeff() + loss < asked;
        for (int n = 0; around && n < 8; ++n) {
          const double angle = n * 0.7853981633974483;
          around = lit(at + loss * Vector2d(std::cos(angle), std::sin(angle)));
        }
        if (lit(at) && !around) continue;
        const auto line = reference::isopixel(open, m, at);
        ++(around ? inside : outside);
        EXPECT_EQ(projection.line(at).has_value(), around) << at.transpose();
        if (!line) continue;
        EXPECT_EQ(projection.project(line->at_z(5e-3)).has_value(), around) << at.transpose();
      }
    }
    EXPECT_GT(inside, 100);
    EXPECT_GT(outside, 100);
    if (projection.symmetric()) {
      double passes = 0;
      double blocked = asked;
      while (blocked - passes > 1e-9) {
        const double middle = (passes + blocked) / 2;
        (lit(Vector2d(0, middle) - m.decenter) ? passes : blocked) = middle;
      }
      EXPECT_LT(projection.max_m(), blocked);
      EXPECT_GT(projection.max_m(), passes - loss);
    }
  }
  // without a stop nothing is in its shadow
  EXPECT_DOUBLE_EQ(ExactProjection(open, microscope(), 5e-3).max_m(), 5e-3);
}

std::string refusal(const std::function<void()>& act) {
  try {
    act();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

TEST(ExactProjectionArguments, are_checked_one_by_one) {
  const System system = reference::spheres();
  for (const bool tabulated : {false, true}) {
    for (const double bad : {0.0, -1e-3, kNan, kFar, -kFar}) {
      EXPECT_EQ(refusal([&] { ExactProjection(system, microscope(), bad, tabulated); }),
                "max_m: must be positive");
    }
    Microscope m = microscope();
    m.focus = kNan;
    EXPECT_EQ(refusal([&] { ExactProjection(system, m, 1e-3, tabulated); }),
              "focus: must be finite");
    System broken = system;
    broken.surfaces[2].index = 0;
    EXPECT_EQ(refusal([&] {
                ExactProjection(broken, microscope(), 1e-3, tabulated);
              }).rfind("surface 3: index", 0),
              0);
    EXPECT_EQ(refusal([&] { ExactProjection(system, microscope(), 1e-6, tabulated); }), "");
  }
}

TEST(ExactProjectionArguments, are_refused_when_too_few_rays_come_through) {
  System system = reference::spheres();
  system.stop->radius = 0.3e-3;
  double inside = 0;
  double outside = 8e-3;
  while (outside - inside > 1e-9) {
    const double middle = (inside + outside) / 2;
    (reference::isopixel(system, microscope(), {middle, 0}) ? inside : outside) = middle;
  }
  EXPECT_EQ(refusal([&] { ExactProjection(system, microscope(), 1.9 * inside); }), "");
  EXPECT_EQ(refusal([&] { ExactProjection(system, microscope(), 2.1 * inside); }),
            "max_m: more than half of the rays up to it are lost");
  EXPECT_EQ(refusal([&] { ExactProjection(system, microscope(), 2.1 * inside, true); }), "");
  Microscope beside = microscope(kFar, {inside + 0.4e-3, 0});
  EXPECT_EQ(refusal([&] { ExactProjection(system, beside, 1e-3, true); }),
            "max_m: the rays in the middle are lost");
}

TEST(ExactProjectionArguments, are_finite_points) {
  for (const Microscope& m : {microscopes()[1], microscopes()[2]}) {
    const ExactProjection projection(reference::spheres(), m, 1e-3);
    for (const double bad : {kNan, kFar, -kFar}) {
      for (int k = 0; k < 3; ++k) {
        Vector3d point(0.1e-3, -0.2e-3, 5e-3);
        ASSERT_TRUE(projection.project(point));
        point[k] = bad;
        EXPECT_EQ(refusal([&] { projection.project(point); }), "point_in_eye: must be finite");
        EXPECT_EQ(refusal([&] { projection.project_with_jacobian(point); }),
                  "point_in_eye: must be finite");
      }
      for (int k = 0; k < 2; ++k) {
        Vector2d place(0.1e-3, -0.2e-3);
        place[k] = bad;
        EXPECT_EQ(refusal([&] { projection.line(place); }), "m: must be finite");
      }
    }
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
