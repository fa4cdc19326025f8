// Maps and the exact projection of systems with a tilted lens, a toric cornea and a gradient.
// SPDX-License-Identifier: Apache-2.0
#include "optics/maps/wide_angle_map.h"
#include "optics/projection/exact_projection.h"
#include "optics/system/frames.h"
#include "optics/system/prescriptions.h"
#include "tests/optics/support.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include <vector>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

/// Navarro's eye, its lens tilted by 4 degrees and decentered by 0.3 mm, its cornea toric.
System tilted_eye() {
  System eye = navarro_with_condensing_lens(true);
  place_group(eye, 2, 3, {{0.3 * kMm, 0, 0}, {0, 0.07, 0}}, {0, 0, 18 * kMm});
  eye.surfaces[4].radius_y = 1.02 * eye.surfaces[4].radius;
  eye.surfaces[4].conic_y = eye.surfaces[4].conic;
  return eye;
}

const std::vector<Eigen::Vector3d> kPoints = {{0, 0, 3 * kMm},
                                              {2 * kMm, 1 * kMm, 3 * kMm},
                                              {-3 * kMm, 2 * kMm, 4 * kMm},
                                              {1 * kMm, -4 * kMm, 2.5 * kMm}};

TEST(SkewSystem, ItsMapAgreesWithTracedBundlesAndLeadsBack) {
  WideAngleSettings settings;
  settings.max_angle = 0.35;
  settings.rings = 4;
  settings.arms = 12;
  settings.angle_nodes = 8;
  settings.depth_nodes = 6;
  const WideAngleMap map(tilted_eye(), settings);
  EXPECT_FALSE(map.symmetric());
  for (const Eigen::Vector3d& point : kPoints) {
    const auto image = map.image(point);
    const auto traced = map.traced_image(point);
    ASSERT_TRUE(image && traced) << point.transpose();
    EXPECT_LT((image->m - traced->m).norm(), 1e-6);
    EXPECT_NEAR(image->focus, traced->focus, 1e-6);
    const auto back = map.point(*image);
    ASSERT_TRUE(back);
    EXPECT_LT((*back - point).norm(), 1e-9);
  }
}

TEST(SkewSystem, ItsProjectionPutsAPointOnTheLineThatIsTracedFromItsImage) {
  System graded = prescription("liou_brennan_condensing").system;
  place_group(graded, 2, 4, {{0, 0.2 * kMm, 0}, {0.05, 0, 0}}, {0, 0, graded.vertex(3)});
  for (const System& eye : {tilted_eye(), graded}) {
    const Microscope microscope;
    const ExactProjection projection(eye, microscope, 5 * kMm);
    EXPECT_FALSE(projection.symmetric());
    EXPECT_LT(projection.max_residual(), 1e-7);
    for (const Eigen::Vector3d& point : kPoints) {
      const auto m = projection.project(point);
      ASSERT_TRUE(m) << point.transpose();
      const auto line = isopixel_line(eye, microscope, *m);
      ASSERT_TRUE(line);
      EXPECT_LT((point - line->origin).cross(line->direction).norm(), 1e-7);
    }
  }
}

TEST(SkewSystem, AStopOffTheAxisIsFilledWhereItIs) {
  System eye = navarro_with_condensing_lens(true);
  place_group(eye, 3, 3, {{0.4 * kMm, 0, 0}, {0, 0.05, 0}}, {0, 0, eye.vertex(3)});
  for (const Pupil::Kind kind : {Pupil::Kind::stop, Pupil::Kind::real_stop}) {
    const PupilTracer tracer(eye, Pupil::of_stop(eye, kind));
    const auto chief = tracer.aim({1 * kMm, 0, 3 * kMm});
    ASSERT_TRUE(chief);
    // Its ray goes through the middle of the stop, as it is traced.
    System pinhole = eye;
    pinhole.stop->radius = kind == Pupil::Kind::stop ? 0.1 * kMm : 1e-9;
    EXPECT_EQ(trace_out(pinhole, *chief).status, TraceStatus::ok);
    pinhole.surfaces[2].placement = {};
    EXPECT_EQ(trace_out(pinhole, *chief).status, TraceStatus::clipped);
  }
}

TEST(SkewSystem, APointNearATiltedLensIsJudgedByThatLens) {
  System eye = navarro_with_condensing_lens(true);
  const double before = surface_height(eye, 2, {3 * kMm, 0});
  place_group(eye, 2, 3, {{0, 0, 0}, {0, 0.1, 0}}, {0, 0, eye.vertex(2)});
  const double after = surface_height(eye, 2, {3 * kMm, 0});
  EXPECT_NEAR(after - before, -3 * kMm * std::tan(0.1), 0.1 * kMm);  // x turns away from z
  const PupilTracer tracer(eye, Pupil::of_stop(eye));
  EXPECT_TRUE(tracer.in_vitreous({3 * kMm, 0, after - 1e-6}));
  EXPECT_FALSE(tracer.in_vitreous({3 * kMm, 0, after + 1e-6}));
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
