// The judge of a soak can condemn: results that are not true, and plans that repeat.
// SPDX-License-Identifier: Apache-2.0
#include "host/trials/soak_check.h"

#include "host/trials/soak_patient.h"
#include "host/trials/soak_script.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <string>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

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

/// Ten seconds of a loop at 20 Hz: where it saw the robot, where that was, and a current.
struct SoakPatient : testing::Test {
  using Places = std::function<double(double)>;  // m along x, of s
  static Stream stream(const char* name, const std::vector<std::string>& channels,
                       const std::function<std::vector<double>(double)>& row) {
    Stream one;
    one.info.name = name;
    for (const std::string& channel : channels) one.info.channels.push_back({channel, "", ""});
    for (int k = 0; k < 200; ++k) {
      const double time = 0.05 * k;
      one.times.push_back(from_seconds(time));
      for (const double value : row(time)) one.values.push_back(value);
    }
    return one;
  }
  static std::vector<std::string> found(const Places& believed, const Places& truth,
                                        const Places& current,
                                        const std::vector<Event>& events = {}) {
    const Stream servo = stream("servo", {"x", "y", "z"}, [&](double time) {
      return std::vector<double>{believed(time), 0, 0};
    });
    const Stream real = stream("truth", {"x", "y", "z"}, [&](double time) {
      return std::vector<double>{truth(time), 0, 0};
    });
    const Stream currents = stream("currents", {"i1", "i2"}, [&](double time) {
      return std::vector<double>{0, current(time)};
    });
    return check_claims({&servo, &real, &currents, &events});
  }
  static double at_rest(double) { return 1e-3; }
  static double on(double) { return -2; }
};

TEST_F(SoakPatient, IsContentWithABeliefThatIsTrue) {
  EXPECT_TRUE(found(
                  at_rest, [](double) { return 1.4e-3; }, on)
                  .empty());
  const auto moving = [](double time) { return 1e-3 * time; };
  EXPECT_TRUE(found(moving, moving, on).empty());
}

TEST_F(SoakPatient, CondemnsHalfAMillimeterForHalfASecondWhileCurrentsFlow) {
  const auto away = [](double begin, double end) {
    return [=](double time) { return time >= begin && time < end ? 1.7e-3 : 1e-3; };
  };
  const auto bad = found(at_rest, away(3, 3.7), on);
  ASSERT_EQ(bad.size(), 1u);
  EXPECT_NE(bad[0].find("up to 0.70 mm"), std::string::npos) << bad[0];
  EXPECT_NE(bad[0].find("from 3.0 s"), std::string::npos) << bad[0];
  EXPECT_TRUE(found(at_rest, away(3, 3.3), on).empty()) << "a third of a second";
  EXPECT_TRUE(found(at_rest, away(3, 6), [](double) { return 0.0; }).empty()) << "at zero";
  const auto not_seen = [](double time) { return time > 3 ? std::nan("") : 1e-3; };
  EXPECT_TRUE(found(not_seen, away(3, 6), on).empty()) << "it claims nothing";
}

TEST_F(SoakPatient, ExcusesALoopWhoseRobotWasPutElsewhereWhileItsSensorRepeated) {
  const auto put_at_four = [](double time) { return time >= 4 ? 4e-3 : 1e-3; };
  const std::vector<Event> repeats{{from_seconds(3), "fault", "pose_sensor stale after 0 s"},
                                   {from_seconds(8), "fault over", "pose_sensor stale"}};
  EXPECT_EQ(found(at_rest, put_at_four, on).size(), 1U) << "its sensor worked";
  const auto bad = found(at_rest, put_at_four, on, repeats);
  ASSERT_EQ(bad.size(), 1U) << "it works again, and is not believed";
  EXPECT_NE(bad[0].find("from 8.0 s"), std::string::npos) << bad[0];
  EXPECT_TRUE(found(at_rest, put_at_four, on, {repeats[0]}).empty());
  const auto carried = [](double time) { return 1e-3 + std::max(0.0, time - 4) * 2e-3; };
  EXPECT_EQ(found(at_rest, carried, on, {repeats[0]}).size(), 1U) << "the loop's own doing";
}

TEST(SoakPlan, DrawsMachinesCoilsAndCamerasThatWereMoved) {
  const SimulatedRoles roles{{"coils", {true, false}}, {"top_camera", {}}, {"pose_sensor", {}}};
  int machines = 0, of_one_coil = 0;
  for (std::uint64_t seed = 1; seed <= 500; ++seed) {
    const SoakPlan plan = draw_plan(seed, roles, 10);
    machines += plan.machine != 0 ? 1 : 0;
    for (const Fault& fault : plan.faults) {
      if (!fault.channel) continue;
      ++of_one_coil;
      EXPECT_GE(*fault.channel, 1);
      EXPECT_LE(*fault.channel, 8);
      EXPECT_EQ(fault.role, "coils");
    }
  }
  EXPECT_GT(machines, 200);
  EXPECT_LT(machines, 300);
  EXPECT_GT(of_one_coil, 20);
}

TEST(SoakPlan, DrawsScriptsThatMisbehaveOnOtherMachinesOnly) {
  const SimulatedRoles roles{{"coils", {true, false}}, {"top_camera", {}}, {"pose_sensor", {}}};
  std::map<std::string, int> drawn;
  for (std::uint64_t seed = 1; seed <= 1000; ++seed) {
    const SoakPlan plan = draw_plan(seed, roles, 10);
    if (plan.script.empty()) continue;
    ++drawn[plan.script];
    EXPECT_NE(plan.machine, 0U) << "the reference's machine is compared to the bit";
    EXPECT_NE(to_string(plan).find("a script that " + plan.script), std::string::npos);
  }
  EXPECT_EQ(drawn.size(), misbehaviors().size());
  for (const auto& [name, count] : drawn) EXPECT_GT(count, 3) << name;
}

TEST(SoakCheck, DemandsNoCertainOutcomeOfAScriptThatMisbehavesButATrueOne) {
  SoakPlan plan;
  plan.script = misbehaviors().front();
  EXPECT_TRUE(
      check_result(plan, {}, ended(Outcome::failed, ExitCode::script_error, "late")).empty());
  EXPECT_TRUE(check_result(plan, {}, ended(Outcome::completed, ExitCode::completed, "")).empty());
  plan.tier = StopTier::stop;
  EXPECT_FALSE(
      check_result(plan, {true, {}}, ended(Outcome::completed, ExitCode::completed, "")).empty())
      << "a stop was swallowed";
  EXPECT_FALSE(check_result(plan, {}, ended(Outcome::stopped, ExitCode::stopped, "by")).empty());
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
