// The protocols of rotating fields and of docking, through the whole program on the simulated rig.
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <string>

namespace vitreo {
namespace VITREO_TEST_FILE {

nlohmann::json of_run(const Workplace& place, const std::string& words) {
  const Spoken spoken = place.vitreo("run " + words + " --json");
  EXPECT_EQ(spoken.exit_code, 0) << spoken.err;
  return spoken.exit_code == 0 ? nlohmann::json::parse(spoken.out)["results"]
                               : nlohmann::json::object();
}

TEST(SwimPath, ACentimeterIsWithinFiftyMicrometersAndAStepOutIsToldWithinASecond) {
  const Workplace place;
  for (int seed = 1; seed <= 2; ++seed) {
    const auto results = of_run(place, "swim_path --seed " + std::to_string(seed));
    EXPECT_GT(results["path_length"], 10e-3);
    EXPECT_LT(results["path_error_rms"], 50e-6) << seed;
    EXPECT_GT(results["path_error_rms"], 2e-6) << "four micrometers of noise go in";
    EXPECT_LT(results["path_error_mean_way_rms"], results["path_error_rms"]) << seed;
    EXPECT_GT(results["path_error_mean_way_rms"], 1e-6) << seed;
    EXPECT_LT(results["step_out_told_after"], 1.0) << seed;
    EXPECT_NEAR(results["response_after_recovery"].get<double>(), 1, 0.1) << seed;
  }
}

// The machine's moment is off by 5 %, its size by 1, its oil by 10: the step-out by as much.
TEST(SwimFrequency, TheCurveIsLinearUpToAStepOutNearTheModels) {
  const Workplace place;
  const auto results = of_run(place, "swim_frequency --seed 2");
  EXPECT_NEAR(results["advance_per_turn"].get<double>(), 188e-6, 0.05 * 188e-6);
  const double ratio =
      results["step_out"].get<double>() / results["step_out_believed"].get<double>();
  EXPECT_NEAR(ratio, 1, 0.35);
  EXPECT_LT(results["curve_misfit_rms"], 60e-6);
}

// A machine that steps out below 9 Hz, while the law may steer at 14 and a spin is not slowed.
TEST(SwimFrequency, ASwimmerThatSteppedOutWhileItSteeredIsBroughtBack) {
  const Workplace place;
  const auto results = of_run(place, "swim_frequency --seed 4");
  EXPECT_LT(results["step_out"], 9);
  EXPECT_GT(results["step_out"], 6);
}

TEST(SwimFrequency, ATailsCurveHasABestFrequency) {
  const Workplace place;
  const auto results = of_run(place, "swim_frequency --rig tail --seed 2");
  EXPECT_GT(results["best_frequency"], 3);
  EXPECT_NEAR(results["best_speed"].get<double>(), 140e-6, 50e-6);
}

TEST(Dock, TheAxisIsWithinThreeDegreesOnASampledMachine) {
  const Workplace place;
  const auto results = of_run(place, "dock feedback=pose_sensor --seed 1");
  EXPECT_LT(results["dock_angle_error_max"], 3 * 3.14159 / 180);
  EXPECT_LT(results["dock_position_error_max"], 50e-6);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
