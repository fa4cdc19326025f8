// The ends of the wide-angle map: where bundles that are aimed by a plain loop are vignetted, where
// the table is off by too much, and what its settings may be.
// SPDX-License-Identifier: Apache-2.0
#include "optics/maps/wide_angle_map.h"
#include "tests/optics/maps/wide_angle_reference.h"
#include "tests/optics/support.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

using Eigen::Vector2d;
using Eigen::Vector3d;
using reference::aimed;
using reference::from;
using reference::in_field;
using reference::kFar;
using reference::Landing;
using reference::Line;
using reference::out;
using reference::vertex_z;

constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr double kNotANumber = std::numeric_limits<double>::quiet_NaN();

/// Whether a ray meets all surfaces within their clear diameters, each about its own axis.
bool is_clear(const System& system, const Line& start) {
  for (int i = 2; i <= system.size(); ++i) {
    const auto behind = out(system, start, i + 1);
    if (!behind) return false;
    const Surface& s = system.surfaces[i - 1];
    const Vector3d from_axis = behind->at - s.placement.decenter;
    if (from_axis.head<2>().norm() > s.semi_diameter) return false;
  }
  return true;
}

/// Whether the whole bundle of a point gets out, the chief ray with it: that of the eye's stop, or
/// of a centered telecentric microscope, which is filled by slopes.
bool passes(const System& system, const WideAngleSettings& s, const Vector3d& point) {
  const double stop_z = vertex_z(system, system.stop->surface);
  const Landing landing = [&](const Vector2d& slope) -> Vector2d {
    if (s.microscope) return out(system, from(point, slope))->slope();
    return out(system, from(point, slope), system.stop->surface)->at_z(stop_z).head<2>();
  };
  const double radius =
      s.microscope ? std::tan(std::asin(s.microscope->numerical_aperture)) : system.stop->radius;
  const Vector2d straight = -point.head<2>() / (vertex_z(system, 3) - point.z());
  const Vector2d chief = aimed(landing, {0, 0}, straight);
  bool clear = is_clear(system, from(point, chief));
  for (int i = 0; i < s.rings && clear; ++i) {
    for (int j = 0; j < s.arms && clear; ++j) {
      const double a = 2 * std::numbers::pi * j / s.arms;
      const Vector2d to =
          std::sqrt((i + 0.5) / s.rings) * radius * Vector2d(std::cos(a), std::sin(a));
      clear = is_clear(system, from(point, aimed(landing, to, chief)));
    }
  }
  return clear;
}

/// At one angle, azimuth, and each of three depths.
std::vector<bool> pass_at(const System& system, const WideAngleSettings& s, double angle,
                          double azimuth = 0) {
  std::vector<bool> made;
  for (const double part : {0.0, 0.5, 1.0})
    made.push_back(passes(system, s, in_field(system, angle, azimuth, part * s.max_depth)));
  return made;
}
bool all(const std::vector<bool>& pass) { return std::ranges::find(pass, false) == pass.end(); }

/// The largest of so many parts of the field at whose rim all bundles pass, tried one by one.
int parts_that_pass(const System& system, const WideAngleSettings& s, int parts, int azimuths) {
  int good = 0;
  for (bool pass = true; pass && good < parts;) {
    for (int j = 0; j < azimuths && pass; ++j) {
      const double azimuth = 2 * std::numbers::pi * j / azimuths;
      pass = all(pass_at(system, s, s.max_angle * (good + 1) / parts, azimuth));
    }
    if (pass) ++good;
  }
  return good;
}

WideAngleSettings few_rays(double max_angle) {
  WideAngleSettings s = reference::make("", true).settings;
  s.max_angle = max_angle;
  s.rings = 2;
  s.arms = 6;
  return s;
}

System clipped(int surface, double semi_diameter) {
  System system = reference::spheres();
  system.surfaces[surface - 1].semi_diameter = semi_diameter;
  return system;
}

/// Up to which angle a clear disc lets all bundles of the meridian pass.
double passing_angle(const System& system, const WideAngleSettings& s) {
  double low = 0.02;
  double high = 0.4;
  EXPECT_TRUE(all(pass_at(system, s, low)) && !all(pass_at(system, s, high)));
  while (high - low > 1e-7) {
    const double middle = (low + high) / 2;
    (all(pass_at(system, s, middle)) ? low : high) = middle;
  }
  return low;
}

// Behind the stop a bundle is the wider the deeper its point is, before it the narrower. The end
// lies between two of the steps, so that a micrometer in the stop, to which the program aims the
// rays of a bundle, decides nothing.
TEST(WideAngleMapLimits, it_ends_where_the_first_of_its_bundles_is_vignetted) {
  WideAngleSettings by_microscope = few_rays(1);
  by_microscope.microscope = Microscope{};
  by_microscope.microscope->numerical_aperture = 0.012;
  by_microscope.microscope->pupil_distance = kFar;
  struct Clip {
    int surface;
    double semi_diameter;
    int parts;
    bool deep;  // the deepest point is vignetted first, else that on the retina
    WideAngleSettings settings;
  };
  for (Clip clip : {Clip{6, 3.4e-3, 117, true, few_rays(1)},
                    {6, 4e-3, 94, true, few_rays(1)},
                    {2, 1.9e-3, 118, false, few_rays(1)},
                    {6, 3.3e-3, 101, true, by_microscope}}) {
    SCOPED_TRACE(clip.parts);
    const System system = clipped(clip.surface, clip.semi_diameter);
    WideAngleSettings& s = clip.settings;
    s.max_angle = passing_angle(system, s) * 160 / (clip.parts + 0.5);
    const auto beyond = pass_at(system, s, s.max_angle * (clip.parts + 1) / 160);
    EXPECT_EQ(beyond.front(), clip.deep);
    EXPECT_EQ(beyond.back(), !clip.deep);
    const WideAngleMap map(system, s);
    EXPECT_DOUBLE_EQ(map.max_angle(), s.max_angle * clip.parts / 160);
    EXPECT_LT(map.tail(), 0.5e-6);
    EXPECT_TRUE(map.image(in_field(system, map.max_angle() - 1e-6, 1.9, 3e-3)));
    EXPECT_FALSE(map.image(in_field(system, map.max_angle() + 1e-6, 1.9, 3e-3)));
  }
}

// A lens that has slipped clips on one side of the field.
TEST(WideAngleMapLimits, without_symmetry_every_side_of_the_field_counts) {
  for (const double toward : {0.6, 2.4}) {
    SCOPED_TRACE(toward);
    System system = clipped(6, 4e-3);
    for (const int i : {5, 6})
      system.surfaces[i].placement.decenter = {0.5e-3 * std::cos(toward), 0.5e-3 * std::sin(toward),
                                               0};
    WideAngleSettings s = few_rays(0.27);
    s.angle_nodes = 9;
    const int good = parts_that_pass(system, s, 10, 16);
    ASSERT_GT(good, 1);
    EXPECT_EQ(parts_that_pass(system, s, 10, 1) > good, toward > 1);  // where that side is another
    const WideAngleMap map(system, s);
    EXPECT_FALSE(map.symmetric());
    EXPECT_DOUBLE_EQ(map.max_angle(), s.max_angle * good / 10);
  }
}

TEST(WideAngleMapLimits, a_tenth_of_the_angle_is_enough_and_less_is_refused) {
  const System system = clipped(6, 3.2e-3);
  const double last = passing_angle(system, few_rays(1));
  const WideAngleMap tenth(system, few_rays(last * 160 / 16.5));
  EXPECT_DOUBLE_EQ(tenth.max_angle(), last * 16 / 16.5);
  expect_refused("max_angle", [&] { WideAngleMap(system, few_rays(last * 160 / 15.5)); });
  expect_refused("max_angle", [&] { WideAngleMap(clipped(6, 0.1e-3), few_rays(0.2)); });
}

// A lens with a strong term in r^8: bundles pass further out than any table is good.
TEST(WideAngleMapLimits, it_ends_where_its_table_would_be_off_by_half_a_micrometer) {
  for (const double times : {20.0, 24.0}) {
    SCOPED_TRACE(times);
    System system = navarro_with_condensing_lens(true);
    system.surfaces[5].aspheric[2] *= times;
    WideAngleSettings s = few_rays(35 * std::numbers::pi / 180);
    const WideAngleMap map(system, s);
    const double parts = map.max_angle() / s.max_angle * 160;
    EXPECT_NEAR(parts, std::round(parts), 1e-9);
    EXPECT_LT(parts, 159.5);
    EXPECT_GT(parts, 120);
    EXPECT_LT(map.tail(), 0.5e-6);
    double worst = 0;
    int answered = 0;
    for (int i = 0; i <= 12; ++i) {
      for (const double depth : {0.0, 2.3e-3, 4.9e-3}) {
        const Vector3d point =
            *point_at_field(system, map.max_angle() * std::sqrt(i / 12.0), depth);
        const auto traced = map.traced_image(point);
        const auto image = map.image(point);
        ASSERT_TRUE(traced);
        if (!image) continue;  // near a fold
        ++answered;
        worst = std::max(
            {worst, (image->m - traced->m).norm(), std::abs(image->focus - traced->focus)});
      }
    }
    EXPECT_LT(worst, 3 * map.tail());
    EXPECT_GT(answered, 20);  // of 39
    // One step further bundles pass, and there is no such table.
    s.max_angle *= std::round(parts + 1) / 160;
    for (const double depth : {0.0, s.max_depth / 2, s.max_depth})
      EXPECT_TRUE(map.traced_image(*point_at_field(system, s.max_angle, depth)));
    EXPECT_LT(WideAngleMap(system, s).max_angle(), 0.999 * s.max_angle);
  }
}

TEST(WideAngleMapLimits, more_nodes_are_taken_where_those_asked_for_do_not_do) {
  for (const auto& [angles, depths] : {std::pair{4, 14}, std::pair{18, 4}, std::pair{4, 4}}) {
    WideAngleSettings s = few_rays(0.35);
    s.max_depth = 8e-3;
    s.angle_nodes = angles;
    s.depth_nodes = depths;
    const System system = navarro_with_condensing_lens(false);
    const WideAngleMap map(system, s);
    EXPECT_DOUBLE_EQ(map.max_angle(), 0.35);
    EXPECT_LT(map.tail(), 1e-9);
  }
}

struct Spoiled {
  std::string name;  // what is refused begins with it; empty: it is not
  WideAngleSettings settings;
};
template <class T>
Spoiled with(const std::string& name, T WideAngleSettings::*member, T value) {
  Spoiled made{name, {}};
  made.settings.*member = value;
  return made;
}

TEST(WideAngleMapLimits, settings_are_refused_by_name) {
  using S = WideAngleSettings;
  const double right_angle = std::numbers::pi / 2;
  std::vector<Spoiled> all{{"", {}},
                           with("max_angle", &S::max_angle, 0.0),
                           with("max_angle", &S::max_angle, -0.1),
                           with("", &S::max_angle, 1e-6),
                           with("", &S::max_angle, std::nextafter(right_angle, 0)),
                           with("max_angle", &S::max_angle, right_angle),
                           with("max_angle", &S::max_angle, 1.6),
                           with("max_angle", &S::max_angle, kInfinite),
                           with("max_angle", &S::max_angle, kNotANumber),
                           with("max_depth", &S::max_depth, 0.0),
                           with("max_depth", &S::max_depth, -1e-3),
                           with("max_depth", &S::max_depth, kInfinite),
                           with("max_depth", &S::max_depth, kNotANumber),
                           with("rings", &S::rings, 0),
                           with("", &S::rings, 1),
                           with("arms", &S::arms, 1),
                           with("", &S::arms, 2),
                           with("angle_nodes", &S::angle_nodes, 3),
                           with("", &S::angle_nodes, 4),
                           with("", &S::angle_nodes, 32),
                           with("angle_nodes", &S::angle_nodes, 33),
                           with("depth_nodes", &S::depth_nodes, 3),
                           with("", &S::depth_nodes, 4),
                           with("", &S::depth_nodes, 32),
                           with("depth_nodes", &S::depth_nodes, 33)};
  all.push_back({"tilt", {}});
  all.back().settings.microscope = Microscope{};
  all.back().settings.microscope->tilt = {0.6, 0};
  for (std::size_t i = 0; i < all.size(); ++i) {
    SCOPED_TRACE(i);
    if (all[i].name.empty())
      EXPECT_NO_THROW(all[i].settings.check());
    else
      expect_refused(all[i].name, [&] { all[i].settings.check(); });
  }
}

// A position that misses the table by less than a nanometer lies on its edge; beyond edge() there
// is nothing.
TEST(WideAngleMapLimits, its_edges_belong_to_it_to_a_nanometer) {
  const System system = reference::spheres();
  WideAngleSettings s = few_rays(0.25);
  s.max_depth = 5e-3;
  const WideAngleMap map(system, s);
  ASSERT_DOUBLE_EQ(map.max_angle(), 0.25);
  const Vector3d stop(0, 0, vertex_z(system, 3));
  const double near = 0.7e-9;
  const double far = 3 * map.edge();
  const double arm = (in_field(system, 0.25, 0, 1e-3) - stop).norm();
  struct Place {
    double angle;
    double depth;
    bool inside;
    double taken_angle;
    double taken_depth;
  };
  for (const Place& at : {Place{0.25 + near / arm, 1e-3, true, 0.25, 1e-3},
                          {0.25 + far / arm, 1e-3, false, 0, 0},
                          {0.1, -near, true, 0.1, 0},
                          {0.1, -far, false, 0, 0},
                          {0.1, 5e-3 + near, true, 0.1, 5e-3},
                          {0.1, 5e-3 + far, false, 0, 0},
                          {0, 0, true, 0, 0},
                          {0, -far, false, 0, 0}}) {
    SCOPED_TRACE(at.angle);
    SCOPED_TRACE(at.depth);
    const Vector3d point = in_field(system, at.angle, 0, at.depth);
    const auto position = map.position_of({std::abs(point.x()), point.z()});
    ASSERT_EQ(position.has_value(), at.inside);
    EXPECT_EQ(map.at({at.angle, at.depth}).has_value(), at.inside);
    if (at.depth >= 0) {
      EXPECT_EQ(map.image(point).has_value(), at.inside);
    }
    if (!at.inside) continue;
    EXPECT_NEAR(position->angle, at.taken_angle, 1e-12);
    EXPECT_NEAR(position->depth, at.taken_depth, near);  // along a retina that slopes
    EXPECT_LE(position->angle, 0.25);
    EXPECT_GE(position->depth, 0);
    EXPECT_LE(position->depth, 5e-3);
  }
  EXPECT_FALSE(map.at({-0.01, 1e-3}));
  EXPECT_FALSE(map.at({kNotANumber, 1e-3}));
  EXPECT_FALSE(map.at({0.1, kNotANumber}));
  EXPECT_FALSE(map.position_of({1e-3, stop.z() + 1e-3}));
}

// The inverse as well: at the rim, beyond it, and on the other side of the axis.
TEST(WideAngleMapLimits, its_inverse_has_the_same_edges) {
  const System system = reference::spheres();
  WideAngleSettings s = few_rays(0.25);
  s.max_depth = 5e-3;
  const WideAngleMap map(system, s);
  const double near = 0.7e-9;
  const double far = 3 * map.edge();
  const double arm = (in_field(system, 0.25, 0, 1e-3) - Vector3d(0, 0, vertex_z(system, 3))).norm();
  const auto inverse = [&](double angle, double depth) {
    return map.point(*map.traced_image(in_field(system, angle, 0, depth))).has_value();
  };
  EXPECT_TRUE(inverse(0.25 + near / arm, 1e-3));
  EXPECT_TRUE(inverse(0.1, 5e-3 + near));
  for (const double beyond : {far / arm, 1e-6, 1e-3, 4e-3})
    EXPECT_FALSE(inverse(0.25 + beyond, 1e-3));
  for (const double beyond : {far, 1e-7, 2e-5, 1e-4}) EXPECT_FALSE(inverse(0.1, 5e-3 + beyond));
  for (const double angle : {1e-6, 1e-3, 3e-3}) {
    const auto there = map.at({angle, 1e-3});
    ASSERT_TRUE(there);
    EXPECT_TRUE(map.find(there->focus, there->height));
    EXPECT_FALSE(map.find(there->focus, -there->height));
  }
}

// A microscope's map opens the eye's stop, and still wants a sound one.
TEST(WideAngleMapLimits, a_system_that_is_unsound_is_refused) {
  WideAngleSettings s = few_rays(0.2);
  s.microscope = Microscope{};
  System system = reference::spheres();
  system.stop->radius = -1e-3;
  EXPECT_THROW(WideAngleMap(system, s), std::invalid_argument);
  s.microscope.reset();
  s.lens_distance = -1e-3;
  expect_refused("lens_distance", [&] { WideAngleMap(reference::spheres(), s); });
}

TEST(WideAngleMapLimits, a_lens_is_moved_only_where_there_is_one_and_it_may_be) {
  System three = reference::spheres();
  three.surfaces.resize(3);
  expect_refused("surfaces", [&] { with_lens_distance(three, 1e-3); });
  System four = reference::spheres();
  four.surfaces.resize(4);
  EXPECT_EQ(with_lens_distance(four, 1.5e-3).surfaces[1].thickness, 1.5e-3);
  for (const double bad : {-1e-12, kInfinite, kNotANumber})
    expect_refused("lens_distance", [&] { with_lens_distance(four, bad); });
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
