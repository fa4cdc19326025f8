// The wide-angle map against traced bundles, its inverse, its edges, and the thesis' own curves
// beside it.
// SPDX-License-Identifier: Apache-2.0
#include "optics/maps/wide_angle_map.h"

#include "optics/maps/thesis_curves.h"
#include "tests/optics/support.h"

#include <gtest/gtest.h>

#include <cmath>
#include <iostream>
#include <limits>
#include <numbers>
#include <random>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

/// Points spread over the field at any azimuth, up to `max_angle` and 8 mm before the retina.
std::vector<Eigen::Vector3d> points(const System& system, double max_angle, int count) {
  std::mt19937 generator(7);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<Eigen::Vector3d> made;
  for (int i = 0; i < count; ++i) {
    const double angle = max_angle * uniform(generator),
                 azimuth = 2 * std::numbers::pi * uniform(generator);
    const Eigen::Vector3d p = *point_at_field(system, angle, 8 * kMm * uniform(generator));
    made.emplace_back(p.x() * std::cos(azimuth), p.x() * std::sin(azimuth), p.z());
  }
  return made;
}

struct RoundTrip {
  double worst = 0;
  int lost = 0;
};

/// Traced bundle -> image place -> table's inverse -> point.
RoundTrip round_trip(const WideAngleMap& map, double max_angle) {
  RoundTrip made;
  for (const Eigen::Vector3d& p : points(map.system(), max_angle, 500)) {
    const auto aerial = map.traced_image(p);
    const auto back = aerial ? map.point(*aerial) : std::nullopt;
    if (!back) {
      ++made.lost;
      continue;
    }
    made.worst = std::max(made.worst, (*back - p).norm());
  }
  return made;
}

TEST(WideAngleMap, TheRoundTripOverThirtyDegreesAndEightMillimetresIsExactToFiveMicrometres) {
  for (const System& system :
       {navarro_with_condensing_lens(true), navarro_with_condensing_lens(false), model_eye_5_3()}) {
    const WideAngleMap map(system);
    EXPECT_GE(map.max_angle(), 30 * kDegree);
    const RoundTrip trip = round_trip(map, 30 * kDegree);
    std::cout << "round trip: worst " << trip.worst / kUm << " um, table up to "
              << map.max_angle() / kDegree << " degrees\n";
    EXPECT_EQ(trip.lost, 0);
    EXPECT_LT(trip.worst, 1 * kUm);  // the issue asks for 5
  }
}

TEST(WideAngleMap, TheTableIsTheTracedImage) {
  const WideAngleMap map(navarro_with_condensing_lens(true));
  for (const Eigen::Vector3d& p : points(map.system(), map.max_angle(), 200)) {
    const auto traced = map.traced_image(p), tabulated = map.image(p);
    ASSERT_TRUE(traced && tabulated) << p.transpose();
    EXPECT_LT((traced->m - tabulated->m).norm(), 1 * kUm);
    EXPECT_NEAR(traced->focus, tabulated->focus, 1 * kUm);
    const auto back = map.point(*tabulated);
    ASSERT_TRUE(back);
    EXPECT_LT((*back - p).norm(), 1e-10);  // the inverse's own promise
  }
}

TEST(WideAngleMap, MicroscopesHaveMapsOfTheirOwn) {
  for (const double pupil_distance : {std::numeric_limits<double>::infinity(), 0.15}) {
    WideAngleSettings settings;
    settings.microscope = Microscope{};
    settings.microscope->pupil_distance = pupil_distance;
    settings.max_angle = 32 * kDegree;
    const WideAngleMap map(model_eye_5_3(), settings);
    const RoundTrip trip = round_trip(map, 30 * kDegree);
    EXPECT_EQ(trip.lost, 0);
    EXPECT_LT(trip.worst, 1 * kUm);
    // Its chief ray is the isopixel line of the microscope focused there.
    const Eigen::Vector3d p = *point_at_field(map.system(), 20 * kDegree, 3 * kMm);
    const AerialPoint aerial = *map.image(p);
    Microscope focused = *settings.microscope;
    focused.focus = aerial.focus;
    const Ray line = *isopixel_line(model_eye_5_3(), focused, aerial.m);
    const Eigen::Vector3d there =
        line.origin + line.direction * ((p.z() - line.origin.z()) / line.direction.z());
    EXPECT_LT((there - p).norm(), 1 * kUm);
  }
}

TEST(WideAngleMap, TheCondensingLensPositionIsPartOfTheMap) {
  WideAngleSettings settings;
  settings.lens_distance = 3.5 * kMm;
  const System system = navarro_with_condensing_lens(true);
  const WideAngleMap moved(system, settings), still(system);
  EXPECT_LT(round_trip(moved, 25 * kDegree).worst, 1 * kUm);
  const Eigen::Vector3d p = *point_at_field(system, 20 * kDegree);
  EXPECT_GT((moved.image(p)->m - still.image(p)->m).norm(), 20 * kUm);  // else it was ignored
  EXPECT_DOUBLE_EQ(moved.system().surfaces[4].thickness, 3.5 * kMm);
}

TEST(WideAngleMap, OnTheAxisTheImageIsOnTheAxis) {
  const WideAngleMap map(navarro_with_condensing_lens(true));
  const auto aerial = map.image({0, 0, 3 * kMm});
  ASSERT_TRUE(aerial);
  EXPECT_EQ(aerial->m.norm(), 0);
  EXPECT_NEAR(aerial->focus, 9.722 * kMm, 1 * kUm);  // facts 2
  EXPECT_LT((*map.point(*aerial) - Eigen::Vector3d(0, 0, 3 * kMm)).norm(), 1e-9);
}

TEST(WideAngleMap, OutsideItsValidityItSaysNothing) {
  const System system = navarro_with_condensing_lens(true);
  const WideAngleMap map(system);
  for (const Eigen::Vector3d& p :
       {Eigen::Vector3d(0, 0, -0.1 * kMm),
        Eigen::Vector3d(6 * kMm, 0, 0.5 * kMm),  // behind the retina
        Eigen::Vector3d(0, 0, 17 * kMm),         // in the lens
        Eigen::Vector3d(0, 0, 9 * kMm),
        *point_at_field(system, 38 * kDegree, 1 * kMm),  // beyond the table
        Eigen::Vector3d(kNan, 0, 1 * kMm)}) {
    EXPECT_FALSE(map.image(p)) << p.transpose();
  }
  for (const AerialPoint& aerial : {AerialPoint{{0, 0}, 7 * kMm}, AerialPoint{{0, 0}, 20 * kMm},
                                    AerialPoint{{15 * kMm, 0}, 9 * kMm},
                                    AerialPoint{{kNan, 0}, 9 * kMm}, AerialPoint{{0, 0}, kNan}}) {
    EXPECT_FALSE(map.point(aerial)) << aerial.focus;
  }
}

TEST(WideAngleMap, TheBoundaryBelongsToTheMapAndWhatIsBeyondDoesNot) {
  for (const System& system : {navarro_with_condensing_lens(true), model_eye_5_3()}) {
    const WideAngleMap map(system);
    EXPECT_LT(map.edge(), 0.1 * kUm);
    for (int i = 0; i <= 40; ++i) {
      const double angle = std::min(30 * kDegree, map.max_angle()) * i / 40, azimuth = 0.7 * i;
      for (const double depth : {0.0, map.max_depth()}) {
        const Eigen::Vector3d flat = *point_at_field(system, angle, depth);
        const Eigen::Vector3d p(flat.x() * std::cos(azimuth), flat.x() * std::sin(azimuth),
                                flat.z());
        const auto traced = map.traced_image(p), tabulated = map.image(p);
        ASSERT_TRUE(traced && tabulated) << p.transpose();
        for (const AerialPoint& aerial : {*traced, *tabulated}) {
          const auto back = map.point(aerial);
          ASSERT_TRUE(back) << angle / kDegree << " degrees, " << depth / kMm << " mm";
          EXPECT_LT((*back - p).norm(), 0.1 * kUm);
          AerialPoint beyond = aerial;
          beyond.focus += (depth == 0 ? -1 : 1) * 5 * kUm;
          EXPECT_FALSE(map.point(beyond))
              << angle / kDegree << " degrees, " << depth / kMm << " mm";
        }
      }
    }
    const Eigen::Vector3d rim = *point_at_field(system, map.max_angle(), 3 * kMm);
    ASSERT_TRUE(map.image(rim));
    EXPECT_TRUE(map.point(*map.image(rim)));
  }
}

TEST(WideAngleMap, NearAFoldItNeverAnswersWithTheOtherPoint) {
  WideAngleSettings settings;
  settings.max_angle =
      36 * kDegree;  // beyond 35 degrees and 7 mm this map folds: images of deeper points come back
  const WideAngleMap map(navarro_with_condensing_lens(true), settings);
  std::mt19937 generator(3);
  std::uniform_real_distribution<double> uniform(0, 1);
  int refused = 0, answered = 0;
  for (int i = 0; i < 1500; ++i) {
    const double angle = map.max_angle() * (1 - 0.05 * uniform(generator)),
                 depth = (8 - 1.5 * uniform(generator)) * kMm;
    const Eigen::Vector3d p = *point_at_field(map.system(), angle, depth);
    const auto traced = map.traced_image(p);
    ASSERT_TRUE(traced);
    const auto back = map.point(*traced);
    EXPECT_EQ(back.has_value(), map.image(p).has_value()) << p.transpose();
    if (!back) {
      ++refused;
      continue;
    }
    ++answered;
    EXPECT_LT((*back - p).norm(), 5 * kUm) << p.transpose();
  }
  EXPECT_GT(refused, 20);  // else this is no test
  EXPECT_GT(answered, 500);
}

struct Look {
  const char* name;
  double pupil_distance;
  Eigen::Vector2d decenter, tilt;
  bool stop;
};

TEST(WideAngleMap, TiltedAndDecenteredMicroscopesAndChainsWithoutStopHaveMapsToo) {
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  const Look looks[] = {{"tilted, telecentric", kInfinite, {0, 0}, {0.035, -0.01}, true},
                        {"tilted, decentered, pupil at 150 mm, no stop",
                         0.15,
                         {0.5 * kMm, -0.3 * kMm},
                         {0.02, 0.02},
                         false},
                        {"centered, no stop", kInfinite, {0, 0}, {0, 0}, false}};
  for (const bool navarro : {true, false}) {
    for (const Look& look : looks) {
      System system = navarro ? navarro_with_condensing_lens(false) : model_eye_5_3();
      if (!look.stop) system.stop.reset();
      WideAngleSettings settings;
      settings.max_angle = 30 * kDegree;
      settings.angle_nodes = 14, settings.depth_nodes = 10, settings.rings = 3, settings.arms = 12;
      settings.microscope = Microscope{};
      settings.microscope->pupil_distance = look.pupil_distance;
      settings.microscope->decenter = look.decenter, settings.microscope->tilt = look.tilt;
      const WideAngleMap map(system, settings);
      EXPECT_GE(map.max_angle(), 29.9 * kDegree) << look.name;
      EXPECT_EQ(map.symmetric(), look.tilt.isZero(0));
      int lost = 0, seen = 0;
      double worst = 0;
      for (const Eigen::Vector3d& p : points(map.system(), 30 * kDegree, 60)) {
        const auto traced = map.traced_image(p);
        EXPECT_EQ(traced.has_value(), map.image(p).has_value());
        if (!traced) continue;  // in the iris' shadow
        ++seen;
        const auto back = map.point(*traced);
        back ? worst = std::max(worst, (*back - p).norm()) : ++lost;
      }
      std::cout << look.name << ": round trip " << worst / kUm << " um of " << seen << " points\n";
      EXPECT_GE(seen, 40) << look.name;
      EXPECT_EQ(lost, 0) << look.name;
      EXPECT_LT(worst, 5 * kUm) << look.name;
    }
  }
}

TEST(WideAngleMap, ATiltedMicroscopeSeesAlongItsOwnIsopixelLine) {
  WideAngleSettings settings;
  settings.max_angle = 25 * kDegree;
  settings.angle_nodes = 12, settings.depth_nodes = 10, settings.rings = 3, settings.arms = 12;
  settings.microscope = Microscope{};
  settings.microscope->pupil_distance = 0.15;
  settings.microscope->tilt = {0.03, 0.01}, settings.microscope->decenter = {0.4 * kMm, 0};
  const WideAngleMap map(model_eye_5_3(), settings);
  const Eigen::Vector3d p(3 * kMm, -2 * kMm, 4 * kMm);
  const auto aerial = map.image(p);
  ASSERT_TRUE(aerial);
  Microscope focused =
      *settings.microscope;  // moved along z until its plane holds the aerial point
  const Ray axis = chief_ray_in_air(model_eye_5_3(), focused, {0, 0});
  focused.focus = aerial->focus +
                  (aerial->m - focused.decenter).dot(axis.direction.head<2>()) / axis.direction.z();
  const Ray plane = chief_ray_in_air(model_eye_5_3(), focused, {0, 0});
  const Eigen::Vector3d in_air(aerial->m.x(), aerial->m.y(),
                               model_eye_5_3().vertex(7) + aerial->focus);
  EXPECT_NEAR((in_air - plane.origin).dot(plane.direction), 0, 1e-12);
  const auto unit = [&](double x, double y) {
    return Eigen::Vector3d(chief_ray_in_air(model_eye_5_3(), focused, {x, y}).origin -
                           plane.origin);
  };
  const Eigen::Vector2d m(unit(1, 0).dot(in_air - plane.origin),
                          unit(0, 1).dot(in_air - plane.origin));
  const Ray line = *isopixel_line(model_eye_5_3(), focused, m);
  const Eigen::Vector3d there =
      line.origin + line.direction * ((p.z() - line.origin.z()) / line.direction.z());
  EXPECT_LT((there - p).norm(), 1 * kUm);
  expect_refused("microscope", [&] { (void)map.at({0.1, 1e-3}); });
  EXPECT_FALSE(map.image({0, 0, -1 * kMm}));
  EXPECT_FALSE(map.image(*point_at_field(map.system(), 26 * kDegree, 1 * kMm)));
  EXPECT_FALSE(map.point({{kNan, 0}, 9 * kMm}));
  EXPECT_FALSE(map.point({{0, 0}, 5 * kMm}));
}

TEST(WideAngleMap, InTheShadowOfTheIrisAMicroscopeSeesNothing) {
  WideAngleSettings settings;
  settings.microscope = Microscope{};
  settings.max_angle = 30 * kDegree;
  System narrow = model_eye_5_3();
  const WideAngleMap wide(narrow, settings);
  narrow.stop->radius = 0.2 * kMm;
  const WideAngleMap map(narrow, settings);
  int shadowed = 0;
  for (const Eigen::Vector3d& p : points(narrow, 28 * kDegree, 100)) {
    ASSERT_TRUE(wide.image(p));
    const bool traced = map.traced_image(p).has_value(), tabulated = map.image(p).has_value();
    EXPECT_EQ(traced, tabulated);
    if (!tabulated) {
      ++shadowed;
      EXPECT_FALSE(map.point(*wide.image(p)));
    }
  }
  EXPECT_GT(shadowed, 10);
}

TEST(WideAngleMap, RefusesBadArguments) {
  const System system = navarro_with_condensing_lens(true);
  const auto refused = [&](const std::string& name,
                           const std::function<void(WideAngleSettings&)>& spoil) {
    WideAngleSettings settings;
    spoil(settings);
    expect_refused(name, [&] { WideAngleMap map(system, settings); });
  };
  refused("max_angle", [](auto& s) { s.max_angle = kNan; });
  refused("max_depth", [](auto& s) { s.max_depth = 0; });
  refused("rings", [](auto& s) { s.rings = 0; });
  refused("angle_nodes", [](auto& s) { s.angle_nodes = 33; });
  refused("depth_nodes", [](auto& s) { s.depth_nodes = 3; });
  refused("lens_distance", [](auto& s) { s.lens_distance = -1; });
  refused("tilt", [](auto& s) {
    s.microscope = Microscope{};
    s.microscope->tilt = {0.6, 0};
  });
  System blind = system;
  blind.stop.reset();
  expect_refused("stop", [&] { WideAngleMap map(blind); });
}

struct Error {
  double mean = 0, worst = 0;
};

Error self_consistency(const WideAngleMap& map, const ThesisCurves& curves, double max_angle) {
  Error error;
  int count = 0;
  for (int i = 0; i < 15; ++i) {
    for (int j = 0; j < 41; ++j) {
      const WideAngleMap::FieldPosition place{max_angle * i / 14, 8 * kMm * j / 40};
      const auto image = map.at(place);
      const auto back = image ? curves.point(image->focus, std::abs(image->height)) : std::nullopt;
      if (!back) continue;
      const WideAngleMap::Plane true_place = map.plane_point(place);
      const double off = std::hypot(back->r - true_place.r, back->z - true_place.z);
      error.mean += off;
      error.worst = std::max(error.worst, off);
      ++count;
    }
  }
  error.mean /= count;
  return error;
}

TEST(ThesisCurves, TheirSelfConsistencyIsThatOfTheFacts) {
  const WideAngleMap map(navarro_with_condensing_lens(true));
  const ThesisCurves curves = fit_thesis_curves(map);
  // Facts 3: mean 0.074 and max 0.22 mm within 30 degrees, 0.097 and 0.58 to 35. Another choice of
  // curves and weights moves these by a quarter.
  const Error within = self_consistency(map, curves, 30 * kDegree),
              all = self_consistency(map, curves, 35 * kDegree);
  std::cout << "thesis' curves: within 30 degrees mean " << within.mean / kMm << " max "
            << within.worst / kMm << " mm; to 35 mean " << all.mean / kMm << " max "
            << all.worst / kMm << " mm\n";
  EXPECT_NEAR(within.mean, 0.074 * kMm, 0.02 * kMm);
  EXPECT_NEAR(within.worst, 0.22 * kMm, 0.06 * kMm);
  EXPECT_NEAR(all.worst, 0.58 * kMm, 0.15 * kMm);
}

TEST(ThesisCurves, IsopixelCurvesAreLinesAndTheRetinaIsNearlyTheFirstIsofocusSurface) {
  const WideAngleMap map(navarro_with_condensing_lens(true));
  const ThesisCurves curves = fit_thesis_curves(map);
  ASSERT_EQ(curves.surfaces.size(), 11u);
  EXPECT_NEAR(curves.surfaces.front().radius, 12 * kMm,
              1 * kMm);  // the retina's; its image is flat to 0.2 mm
  EXPECT_NEAR(curves.surfaces.front().pole, 0,
              0.25 * kMm);  // facts 4: the circle misses the pole by 0.2 mm
  for (std::size_t i = 1; i < curves.surfaces.size(); ++i) {
    EXPECT_GT(curves.surfaces[i].pole, curves.surfaces[i - 1].pole);
    EXPECT_LT(curves.surfaces[i].radius, curves.surfaces[i - 1].radius);  // figure 3.6a: monotone
  }
  ASSERT_GE(curves.curves.size(), 14u);
  for (const IsopixelCurve& curve : curves.curves) EXPECT_LT(curve.max_residual, 20 * kUm);
  EXPECT_FALSE(curves.point(7 * kMm, 1 * kMm));
  EXPECT_FALSE(curves.point(9 * kMm, 20 * kMm));
  EXPECT_FALSE(curves.point(kNan, kNan));
}

TEST(ThesisCurves, RefusesBadArguments) {
  const WideAngleMap map(navarro_with_condensing_lens(true));
  ThesisSettings settings;
  settings.samples = 2;
  expect_refused("samples", [&] { fit_thesis_curves(map, settings); });
  settings = {};
  settings.conic = kNan;
  expect_refused("conic", [&] { fit_thesis_curves(map, settings); });
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
