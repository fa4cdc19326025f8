// The two sessions that calibrate the viewing chain, in their short forms on the simulated rig.
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace vitreo {
namespace {

nlohmann::json results_of(const std::string& words) {
  const Workplace place;
  const Spoken spoken = place.vitreo(words + " --json --seed 3");
  EXPECT_EQ(spoken.exit_code, 0) << spoken.out << spoken.err;
  const auto said = nlohmann::json::parse(spoken.out);
  EXPECT_EQ(said["outcome"], "completed");
  return said["results"];
}

// Eight places by one side camera leave some 30 um of depth to the calibration (docs/chain.md).
TEST(ChainSessions, PlacesByBothCamerasLeaveLittleOfTheDepthToTheCalibration) {
  const auto results = results_of("run calibrate_bench places=6 judged=2");
  EXPECT_LT(results["calibration_part_of_depth"], 100e-6);
  EXPECT_LT(results["after_depth_90"], 300e-6);
  EXPECT_LT(results["session_chi2_per_degree"], 3);
}

TEST(ChainSessions, ALandingAndAShortFlightLeaveTheHeightBetterKnownThanTheDepth) {
  const auto results = results_of("run calibrate_in_eye landings=1 frames=6");
  EXPECT_LT(results["calibration_part_of_height"], results["calibration_part_of_depth"]);
  EXPECT_GT(results["height_sigma_median"], 20e-6) << "no frame is better than its noise";
}

TEST(ChainSessions, FramesOfARunThatGoesOnRefineTheChain) {
  const auto results = results_of("run calibrate_in_eye landings=1 frames=5 further=20");
  EXPECT_GE(results["refined_by_frames"], 10);
  EXPECT_LT(results["refined_part_of_height"], results["calibration_part_of_height"]);
  EXPECT_EQ(results["bench_changed"], 0);
}

// Five percent of a pupil at half a meter.
TEST(ChainSessions, ATargetShowsTheMicroscopesPupil) {
  const auto results = results_of("run calibrate_microscope");
  EXPECT_LT(results["pupil_power_sigma"], 0.1);
  EXPECT_GT(results["pupil_power"], -0.1);
  EXPECT_LT(results["pupil_power"], 4.1);
}

}  // namespace
}  // namespace vitreo
