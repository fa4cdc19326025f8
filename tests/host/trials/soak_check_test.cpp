// The judge of a soak can condemn: results that are not true, and plans that repeat.
// SPDX-License-Identifier: Apache-2.0
#include "host/trials/soak_check.h"

#include <gtest/gtest.h>

namespace vitreo {
namespace {

SoakPlan told(StopTier tier) {
  SoakPlan plan;
  plan.tier = tier;
  plan.at = 1;
  return plan;
}

RunResult ended(Outcome outcome, ExitCode code, const std::string& reason) {
  RunResult result;
  result.outcome = outcome;
  result.exit_code = code;
  result.reason = reason;
  return result;
}

TEST(SoakCheck, PassesWhatIsTrue) {
  EXPECT_TRUE(check_result({}, {}, ended(Outcome::completed, ExitCode::completed, "")).empty());
  EXPECT_TRUE(check_result(told(StopTier::stop), {true, {}},
                           ended(Outcome::stopped, ExitCode::stopped, "by"))
                  .empty());
  EXPECT_TRUE(check_result(told(StopTier::abort), {true, {}},
                           ended(Outcome::aborted, ExitCode::aborted, "by"))
                  .empty());
}

TEST(SoakCheck, CondemnsAnEndRecordThatIsNotTrue) {
  EXPECT_FALSE(check_result(told(StopTier::stop), {true, {}},
                            ended(Outcome::completed, ExitCode::completed, ""))
                   .empty());
  EXPECT_FALSE(check_result(told(StopTier::abort), {true, {}},
                            ended(Outcome::stopped, ExitCode::stopped, "by"))
                   .empty());
  EXPECT_FALSE(
      check_result({}, {}, ended(Outcome::stopped, ExitCode::stopped, "by nobody")).empty());
  EXPECT_FALSE(
      check_result({}, {}, ended(Outcome::aborted, ExitCode::aborted, "a device")).empty());
  EXPECT_FALSE(
      check_result({}, {}, ended(Outcome::failed, ExitCode::completed, "an error")).empty());
  SoakPlan faulty;
  faulty.faults = {{"coils", "silent"}};
  EXPECT_FALSE(check_result(faulty, {}, ended(Outcome::aborted, ExitCode::aborted, "")).empty())
      << "no reason";
  EXPECT_FALSE(
      check_result(faulty, {}, ended(Outcome::failed, ExitCode::internal, "a bug")).empty());
  EXPECT_TRUE(
      check_result(faulty, {}, ended(Outcome::aborted, ExitCode::aborted, "no answer")).empty());
}

TEST(SoakPlan, FollowsFromItsSeedAloneAndHasEveryKindOfEnd) {
  const SimulatedRoles roles{{"coils", {true, false}},
                             {"pose_sensor", {}},
                             {"top_camera", {}},
                             {"lens_mover", {true, true}}};
  int kills = 0, stops = 0, alone = 0;
  std::map<std::string, int> kinds;
  for (std::uint64_t seed = 1; seed <= 500; ++seed) {
    const SoakPlan plan = draw_plan(seed, roles, 10);
    EXPECT_EQ(to_string(plan), to_string(draw_plan(seed, roles, 10)));
    kills += plan.kill ? 1 : 0;
    stops += plan.tier != StopTier::none ? 1 : 0;
    alone += plan.faults.empty() ? 1 : 0;
    for (const Fault& fault : plan.faults) {
      EXPECT_NO_THROW(check(fault, roles)) << to_string(fault);
      ++kinds[fault.kind];
    }
  }
  EXPECT_GT(kills, 10);
  EXPECT_GT(stops, 150);
  EXPECT_GT(alone, 50);
  EXPECT_EQ(kinds.size(), fault_kinds().size());
}

}  // namespace
}  // namespace vitreo
