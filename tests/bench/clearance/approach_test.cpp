// A few of the approaches that clearance_approaches measures by the hundred, and the predictive
// form against the projection.
// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/clearance/approach.h"

#include "control/robots.h"
#include "tests/bench/clearance/predictive.h"

#include <gtest/gtest.h>

namespace vitreo::approaches {
namespace VITREO_TEST_FILE {

TEST(Approach, LetDownOntoTheRetinaItIsRedBeforeItTouchesAndNeverShownFarther) {
  ApproachSetting setting;
  setting.seed = 11;
  setting.sink = true;
  const ApproachResult result = run_approach(setting);
  EXPECT_TRUE(result.red_first);
  EXPECT_GT(result.optimism, -0.5) << "it was shown";
  EXPECT_LE(result.optimism, 50e-6);
}

TEST(Approach, DrivenToTheMarginItComesThereAndNoFurther) {
  for (const bool upright : {false, true}) {
    ApproachSetting setting;
    setting.upright = upright;
    setting.feedback = Feedback::pose_sensor;
    setting.margin = 0.3e-3;
    const ApproachResult result = run_approach(setting);
    EXPECT_GT(result.least_true, setting.margin - 10e-6) << result.ending;
    // The margin is of the bound, 0.15 mm nearer; the eye may stand that much off to either side.
    EXPECT_LT(result.least_true, setting.margin + 0.3e-3) << result.ending;
  }
}

// The judge's own zero, whatever eye was drawn: a robot that lies on the plant's retina is at none
// of it. Seed 208's eye stands 0.05 mm higher than believed.
TEST(Approach, TheJudgeKnowsWhereThePlantsEyeStands) {
  ApproachSetting setting;
  setting.seed = 208;
  setting.sink = true;
  setting.feedback = Feedback::pose_sensor;
  EXPECT_NEAR(run_approach(setting).end_true, 0, 10e-6);
}

// Without limits in the way: the first of N equal steps to the margin.
TEST(Approach, ThePredictiveFormIsTheProjectionWithTheHorizonsRate) {
  control::UncertainPose pose;
  pose.position = {0, 0, -4.1e-3};
  pose.axis_sigma = 0;
  const control::Clearance near =
      control::clearance(control::surface_of(control::coni_2mm()), {}, pose);
  const Eigen::Vector3d wanted(0.2e-3, 0, -1e-3);
  PredictiveSettings program;
  CurrentMap idle;
  idle.rest = control::Currents::Zero(8);
  idle.slope = Eigen::MatrixXd::Zero(8, 3);
  control::KeepOut projection;
  projection.margin = program.margin;
  projection.rate = 1 / (program.frames * program.period);
  const PredictiveResult found = predictive_keep_out(program, near, wanted, {0, 0, 0}, 1, idle);
  EXPECT_LT(found.violation, 1e-3);
  EXPECT_LT((found.velocity - control::keep_out(projection, near, wanted).velocity).norm(), 2e-6);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::approaches
