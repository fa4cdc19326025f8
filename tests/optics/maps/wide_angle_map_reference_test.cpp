// WideAngleMap against bundles that are aimed and focused by a plain loop, for the eye's stop and
// microscopes of all kinds; its inverse and its meridional functions against the same.
// SPDX-License-Identifier: Apache-2.0
#include "optics/maps/wide_angle_map.h"
#include "tests/optics/maps/wide_angle_reference.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <vector>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

using Eigen::Matrix2d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using reference::Case;
using reference::in_field;
using reference::kFar;
using reference::make;
using reference::seen;

std::vector<Case> symmetric_cases() {
  std::vector<Case> all{make("stop", true),
                        make("telecentric", true, kFar),
                        make("decentered, telecentric", true, kFar, {0.3e-3, -0.5e-3}),
                        make("pupil", true, 85e-3),
                        make("pupil on the eye's side", true, -60e-3),
                        make("no stop", true, 85e-3)};
  all.back().system.stop.reset();
  all[0].system.stop->radius = 1.3e-3;
  return all;
}
struct Field {
  double angle;
  double azimuth;
  double depth;
};
/// All quadrants, both ends of the depth nearly, the axis nearly.
const std::vector<Field> kFields{
    {0.21, 0.7, 2.9e-3}, {0.26, 2.5, 0.1e-3}, {0.16, 4.1, 6.1e-3}, {0.006, 5.3, 4.4e-3}};

/// Against a bundle of a microscope the program's own samples are off by what its chord steps
/// leave; that grows with the fourth power of the aperture.
double focus_error(const Case& c) { return c.settings.microscope ? 9e-9 : 1e-14; }

void expect_images(const Case& c) {
  SCOPED_TRACE(c.name);
  const WideAngleMap map(c.system, c.settings);
  EXPECT_EQ(map.symmetric(), c.symmetric);
  EXPECT_DOUBLE_EQ(map.max_angle(), c.settings.max_angle);
  EXPECT_DOUBLE_EQ(map.max_depth(), c.settings.max_depth);
  EXPECT_GT(map.tail(), 0);
  EXPECT_LT(map.tail(), 2e-8);
  EXPECT_DOUBLE_EQ(map.edge(), 1e-9 + 4 * map.tail());
  for (const Field& f : kFields) {
    const Vector3d point = in_field(c.system, f.angle, f.azimuth, f.depth);
    const AerialPoint mine = seen(c.system, c.settings, point);
    const auto traced = map.traced_image(point);
    ASSERT_TRUE(traced);
    EXPECT_NEAR(traced->focus, mine.focus, focus_error(c)) << f.azimuth;
    EXPECT_LT((traced->m - mine.m).norm(), 0.3 * focus_error(c)) << f.azimuth;
    const auto image = map.image(point);
    ASSERT_TRUE(image);
    EXPECT_NEAR(image->focus, traced->focus, 2 * map.tail()) << f.azimuth;
    EXPECT_LT((image->m - traced->m).norm(), 2 * map.tail()) << f.azimuth;
    const auto back = map.point(*image);
    ASSERT_TRUE(back);
    EXPECT_LT((*back - point).norm(), 1e-10) << f.azimuth;
    const auto found = map.point(mine);
    ASSERT_TRUE(found);
    EXPECT_LT((*found - point).norm(), 8 * map.tail() + 4 * focus_error(c)) << f.azimuth;
  }
}

TEST(WideAngleMapReference, images_points_as_bundles_do) {
  for (const Case& c : symmetric_cases()) expect_images(c);
}

TEST(WideAngleMapReference, has_the_meridional_plane_as_traced) {
  for (const Case& c : symmetric_cases()) {
    SCOPED_TRACE(c.name);
    const WideAngleMap map(c.system, c.settings);
    for (const auto& [angle, depth] : {std::pair{0.23, 0.7e-3}, std::pair{0.12, 5.2e-3}}) {
      const WideAngleMap::FieldPosition position{angle, depth};
      const Vector3d point = in_field(c.system, angle, 0, depth);
      const auto plane = map.plane_point(position);
      EXPECT_NEAR(plane.r, std::abs(point.x()), 1e-12);
      EXPECT_NEAR(plane.z, point.z(), 1e-12);
      const auto back = map.position_of(plane);
      ASSERT_TRUE(back);
      EXPECT_NEAR(back->angle, angle, 1e-11);
      EXPECT_NEAR(back->depth, depth, 1e-12);
      const AerialPoint mine = seen(c.system, c.settings, point);
      const auto at = map.at(position);
      ASSERT_TRUE(at);
      const double error = 2 * map.tail() + focus_error(c);
      EXPECT_NEAR(at->focus, mine.focus, error);
      // the point lies at -x, its image at +x: inverted, hence negative
      EXPECT_NEAR(at->height, mine.m.x() * (point.x() > 0 ? 1 : -1), error);
      EXPECT_LT(at->height, 0);
      const double h[] = {1e-3, 3e-5};  // rad, m
      for (int k = 0; k < 2; ++k) {
        double focus[4];
        double height[4];
        for (int i = 0; i < 4; ++i) {
          const double step = h[k] * (i < 2 ? i - 2 : i - 1);
          const AerialPoint there =
              seen(c.system, c.settings,
                   in_field(c.system, angle + (k == 0 ? step : 0), 0, depth + (k == 1 ? step : 0)));
          focus[i] = there.focus;
          height[i] = -std::abs(there.m.x());
        }
        const auto slope = [&](const double* v) {
          return (8 * (v[2] - v[1]) - (v[3] - v[0])) / (12 * h[k]);
        };
        EXPECT_NEAR(at->per_position(0, k), slope(focus), 3e-5 + 30 * error / h[k] / 10);
        EXPECT_NEAR(at->per_position(1, k), slope(height), 3e-5 + 30 * error / h[k] / 10);
      }
      const auto found = map.find(at->focus, at->height);
      ASSERT_TRUE(found);
      EXPECT_NEAR(found->angle, angle, 1e-9);
      EXPECT_NEAR(found->depth, depth, 1e-10);
    }
  }
}

// Without a condensing lens the image of a short eye is virtual, behind it and upright.
TEST(WideAngleMapReference, has_the_upright_image_of_an_eye_alone) {
  Case c = make("upright", true);
  c.system.surfaces[0].thickness = 10e-3;
  for (const int i : {5, 6}) c.system.surfaces[i].radius = kFar;
  c.settings.max_angle = 0.2;
  c.settings.max_depth = 3e-3;
  const WideAngleMap map(c.system, c.settings);
  EXPECT_GT(map.at({0.1, 1e-3})->height, 0);
  const Vector3d point = in_field(c.system, 0.15, 0.7, 1e-3);
  const AerialPoint mine = seen(c.system, c.settings, point);
  const auto image = map.image(point);
  ASSERT_TRUE(image);
  EXPECT_LT(image->focus, 0);
  EXPECT_NEAR(image->focus, mine.focus, 1e-8);
  EXPECT_LT((image->m - mine.m).norm(), 1e-8);
  const auto back = map.point(*image);
  ASSERT_TRUE(back);
  EXPECT_LT((*back - point).norm(), 1e-10);
}

TEST(WideAngleMapReference, moves_the_lens_as_it_is_told) {
  Case c = make("stop", true);
  const System before = c.system;
  c.settings.lens_distance = 6.1e-3;
  const WideAngleMap map(c.system, c.settings);
  System moved = c.system;
  moved.surfaces[4].thickness = 6.1e-3;  // behind the eye's last vertex
  const System made = with_lens_distance(before, 6.1e-3);
  for (int i = 0; i < 7; ++i) {
    EXPECT_EQ(map.system().surfaces[i].thickness, moved.surfaces[i].thickness);
    EXPECT_EQ(made.surfaces[i].thickness, moved.surfaces[i].thickness);
    EXPECT_EQ(made.surfaces[i].radius, moved.surfaces[i].radius);
    EXPECT_EQ(made.surfaces[i].index, moved.surfaces[i].index);
  }
  EXPECT_EQ(with_lens_distance(before, 0).surfaces[4].thickness, 0);
  const Vector3d point = in_field(moved, 0.19, 3.9, 3.3e-3);
  const AerialPoint mine = seen(moved, c.settings, point);
  const auto image = map.image(point);
  ASSERT_TRUE(image);
  EXPECT_NEAR(image->focus, mine.focus, 2 * map.tail());
  EXPECT_LT((image->m - mine.m).norm(), 2 * map.tail());
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
