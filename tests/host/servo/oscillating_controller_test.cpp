// Rotating controller of a swimmer with a flexible tail in an oscillating field, on the simulator's
// own plant: path, and what it refuses.
// SPDX-License-Identifier: Apache-2.0
#include "host/servo/rotating_controller.h"
#include "tests/bench/machines/swim_bench.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace vitreo {
namespace VITREO_TEST_FILE {

using machines::SwimBench;

// What is beyond the mean way is the beat itself, which swings the robot aside
// (docs/rotating_fields.md).
TEST(OscillatingController, ItsMeanWayIsWithinFiftyMicrometersOfACentimeter) {
  EXPECT_GT(machines::centimeter().length(), 10e-3);
  for (const unsigned seed : {1U, 4U, 5U}) {
    const machines::PathError found = machines::path_error_of(seed, true);
    EXPECT_LT(found.mean_way, 50e-6) << seed;
    EXPECT_LT(found.rms, 100e-6) << seed;
    EXPECT_EQ(found.told, 0) << seed;
  }
}

// A field that is a quarter of what it was; a lower frequency would be no remedy.
TEST(OscillatingController, TellsATailThatDoesNotFollow) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    SwimBench bench(seed, machines::tail_law(seed), machines::kTailField, machines::tail_model());
    bench.go(10);
    bench.path() = {machines::centimeter(machines::kTailSpeed, machines::kTailAcceleration),
                    bench.now()};
    bench.go(20);
    ASSERT_TRUE(bench.found.empty()) << seed;
    const double begin = bench.now();
    const double limit = bench.controller().state().limit;
    bench.weaken(0.25);
    bench.go(8);
    ASSERT_FALSE(bench.found.empty()) << seed;
    // The law must command full speed first, then three seconds are judged (of 24: 5.4 at most).
    EXPECT_LT(bench.found.front() - begin, 6) << seed;
    EXPECT_NEAR(bench.controller().state().limit, limit, 0.1 * limit) << seed;
  }
}

TEST(OscillatingController, WithoutACurveItIsSpunAndNotSteered) {
  SwimBench bench = machines::beating(5);
  bench.go(3);
  EXPECT_EQ(bench.controller().state().rotation.frequency, 0);
  EXPECT_LT((bench.seen() - Eigen::Vector3d(0, 0, 0)).norm(), 0.2e-3) << "it sinks slowly";
  EXPECT_GT(machines::beaten_speed(bench, 9), 50e-6);
  EXPECT_NEAR(bench.controller().state().rotation.frequency, 9, 1e-9);
}

TEST(OscillatingController, IsForARobotWithAFlexibleTail) {
  RotatingControllerSettings settings;
  settings.law.mode = control::RotatingMode::oscillating;
  EXPECT_THROW(RotatingController(machines::helix_model(), settings), std::invalid_argument);
  EXPECT_NO_THROW(RotatingController(machines::tail_model(), settings));
  settings.law.mode = control::RotatingMode::helix;
  EXPECT_THROW(RotatingController(machines::tail_model(), settings), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
