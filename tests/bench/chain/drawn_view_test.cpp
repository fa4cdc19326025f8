// The simulated camera's lines of sight on a bench that is turned and moved, against the true
// bench's own tracer.
// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/optics_sample.h"
#include "devices/sim/view.h"

#include <gtest/gtest.h>

#include "true_bench.h"
#include <functional>
#include <map>
#include <string>

namespace vitreo::optics {
namespace {

struct Off {
  std::map<std::string, double> truth;  // as TrueBench names them
  std::function<void(sim::OpticsSample&)> draw;
};

NominalChain nominal_chain() {
  NominalChain nominal;
  nominal.prescription = prescription("model_eye_5_3");
  nominal.image = {14.3e-6, {691.5, 517.5}};
  nominal.robot = {1e-3, 0.5e-3};
  return nominal;
}

/// px between the pixel that shows a point of the eye by the simulated camera and by the tracer.
double apart(const Off& off, double& moved) {
  const NominalChain nominal = nominal_chain();
  const TrueBench straight(nominal, ChainSigmas::none(), 1);
  const TrueBench bench = straight.moved(off.truth);
  sim::LaboratorySettings settings;
  settings.eye = nominal.prescription.system;
  settings.top_image = nominal.image;
  sim::OpticsSample sample;
  off.draw(sample);
  const sim::LaboratorySettings drawn = sim::with_optics(settings, sample);
  const sim::View view = sim::eye_view(drawn.eye, drawn.microscope, drawn.top_image, drawn.top.size,
                                       drawn.world.cavity.vertex);
  double most = 0;
  for (const Eigen::Vector3d& point :
       {Eigen::Vector3d(0, 0, 5e-3), Eigen::Vector3d(2e-3, -1e-3, 2e-3),
        Eigen::Vector3d(-2.5e-3, 1.5e-3, 8e-3)}) {
    const Eigen::Vector3d in_world = settings.world.cavity.vertex + point;
    const auto shown = view.pixel_of(view.point_in_view(in_world));
    const auto expected = bench.pixel(point);
    EXPECT_TRUE(shown && expected);
    if (!shown || !expected) return 1e9;
    most = std::max(most, (*shown - *expected).norm());
    moved = std::max(moved, (*expected - *straight.pixel(point)).norm());
  }
  return most;
}

// pixel_of() ends within 0.02 px and lines are interpolated: together below a twentieth.
void expect_alike(const Off& off) {
  double moved = 0;
  EXPECT_LT(apart(off, moved), 0.05);
  EXPECT_GT(moved, 1) << "the change must be one that a picture shows";
}

TEST(DrawnView, OfACondensingLensThatStandsAskewIsTheTracersOwn) {
  expect_alike({{{"lens_tilt_x", 0.035},
                 {"lens_tilt_y", -0.05},
                 {"lens_aside_x", 0.5e-3},
                 {"lens_aside_y", -0.3e-3}},
                [](sim::OpticsSample& one) {
                  one.lens_tilt = {0.035, -0.05};
                  one.lens_aside = {0.5e-3, -0.3e-3};
                }});
}

TEST(DrawnView, OfAnEyeThatIsTurnedIsTheTracersOwn) {
  expect_alike({{{"eye_rotation_x", 0.052}, {"eye_rotation_y", 0.08}}, [](sim::OpticsSample& one) {
                  one.eye_rotation = {0.052, 0.08};
                }});
}

TEST(DrawnView, OfAnEyeWhoseOwnLensIsTiltedIsTheTracersOwn) {
  expect_alike({{{"inner_lens_tilt_x", -0.05},
                 {"inner_lens_tilt_y", 0.1},
                 {"inner_lens_aside_x", 0.2e-3},
                 {"inner_lens_aside_y", 0.4e-3}},
                [](sim::OpticsSample& one) {
                  one.inner_lens_tilt = {-0.05, 0.1};
                  one.inner_lens_aside = {0.2e-3, 0.4e-3};
                }});
}

TEST(DrawnView, OfABenchWithEverythingOffIsTheTracersOwn) {
  expect_alike({{{"lens_tilt_x", 0.035},
                 {"lens_aside_y", -0.5e-3},
                 {"lens_axial", 0.4e-3},
                 {"eye_rotation_y", 0.05},
                 {"inner_lens_tilt_x", 0.05},
                 {"axial_length", 0.1e-3},
                 {"object_plane", -0.5e-3},
                 {"pupil_power", 2},
                 {"microscope_tilt_x", 8e-3}},
                [](sim::OpticsSample& one) {
                  one.lens_tilt.x() = 0.035;
                  one.lens_aside.y() = -0.5e-3;
                  one.lens_axial = 0.4e-3;
                  one.eye_rotation.y() = 0.05;
                  one.inner_lens_tilt.x() = 0.05;
                  one.axial_length = 0.1e-3;
                  one.object_plane = -0.5e-3;
                  one.pupil_power = 2;
                  one.microscope_tilt.x() = 8e-3;
                }});
}

}  // namespace
}  // namespace vitreo::optics
