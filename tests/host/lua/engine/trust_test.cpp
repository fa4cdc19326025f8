// What a loop may trust: clocks that are wrong, pictures that are old, cameras that were moved,
// coils that do not obey. Either the robot stays where it is believed, or the coils are at zero in
// time and the record says why. Judged by the simulator's truth.
// SPDX-License-Identifier: Apache-2.0
#include "host/engine/run_engine.h"
#include "host/lua/engine/engine.h"
#include "host/session/faults.h"
#include "tests/host/lua/engine/written_run.h"
#include "tests/host/rig/fake_rig.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <string>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

constexpr const char* kPose = R"(
return { title = "by the pose sensor", coils = {}, pose_sensor = {}, sample = {} }
)";
/// m: a robot under the thesis' PD is so far from a target that it was given a second ago, by a
/// clock that is right as well.
constexpr double kOnItsWay = 0.4e-3;
// Rests at the center; from 6.2 s on it goes to and fro.
constexpr const char* kGo = R"(
local servo <close> = rig:servo { feedback = "pose_sensor", law = "%LAW%" }
servo:hold { 0, 0, 0 }
rig.sample:insert_robot { 0, 0, 0 }
servo:wait_until_tracked { timeout = 5*s }
run:wait(6*s)
for k = 1, %TURNS% do
  servo:hold(k % 2 == 1 and { 1*mm, 0, 0.5*mm } or { 0, 0, 0 })
  run:wait(1.5*s)
end
)";

struct Judged {
  Outcome outcome = Outcome::completed;
  std::string said;    // events from the fault on, and the reason
  double begun = 0;    // s, of the fault
  double zero = 1e9;   // s after it: the coils at zero for good; 1e9: never
  double error = 0;    // m: of belief and truth while currents flowed, from the fault on
  double settled = 0;  // m: of truth and target, a second and more after the last one was given
  bool says(const std::string& text) const { return said.find(text) != std::string::npos; }
};

/// m: the truth at `time`, between its rows.
std::optional<Eigen::Vector3d> true_place(const Stream& truth, Time time) {
  const auto after = std::lower_bound(truth.times.begin(), truth.times.end(), time);
  if (after == truth.times.begin() || after == truth.times.end()) return std::nullopt;
  const auto row = static_cast<std::size_t>(after - truth.times.begin());
  const auto at = [&](std::size_t k) {
    return Eigen::Vector3d(truth.at(k, 0), truth.at(k, 1), truth.at(k, 2));
  };
  const double part =
      to_seconds(time - truth.times[row - 1]) / to_seconds(truth.times[row] - truth.times[row - 1]);
  const Eigen::Vector3d place = at(row - 1) + part * (at(row) - at(row - 1));
  return place.allFinite() ? std::optional(place) : std::nullopt;
}

void judge(Judged& judged, const Recorder& recorder) {
  for (const Event& event : recorder.events()) {
    if (event.kind == "fault" && judged.begun == 0) judged.begun = to_seconds(event.time);
    if (judged.begun > 0) judged.said += event.kind + ": " + event.text + "\n";
  }
  if (recorder.stream("currents") == nullptr || recorder.stream("servo") == nullptr) return;
  const Stream& currents = *recorder.stream("currents");
  double last = 0;
  for (std::size_t k = 0; k < currents.times.size(); ++k)
    for (std::size_t coil = 0; coil < currents.info.channels.size(); ++coil)
      if (std::abs(currents.at(k, coil)) > 0.02) last = to_seconds(currents.times[k]);
  if (recorder.end()->experiment_time - last > 0.2) judged.zero = last - judged.begun;
  const Stream& servo = *recorder.stream("servo");
  const Stream& truth = *recorder.stream("truth");
  Eigen::Vector3d target(NAN, NAN, NAN);
  double since = 0;
  for (std::size_t k = 0; k < servo.times.size(); ++k) {
    const double time = to_seconds(servo.times[k]);
    const Eigen::Vector3d believed(servo.at(k, 0), servo.at(k, 1), servo.at(k, 2));
    const Eigen::Vector3d wanted(servo.at(k, 3), servo.at(k, 4), servo.at(k, 5));
    if (!(wanted == target)) {
      target = wanted;
      since = time;
    }
    const auto place = true_place(truth, servo.times[k]);
    if (time < judged.begun || time > last || !place || !believed.allFinite()) continue;
    judged.error = std::max(judged.error, (believed - *place).norm());
    if (time - since > 1) judged.settled = std::max(judged.settled, (wanted - *place).norm());
  }
}

class TrustTest : public testing::Test {
 protected:
  Judged run(const std::string& rig, const std::string& body, const std::string& fault,
             std::uint64_t seed = 1) {
    RunRequest request = written_run(folder.path(), rig, body);
    request.how.seed = seed;
    if (!fault.empty()) request.how.faults = {fault};
    Judged judged;
    const RunResult result =
        run_protocol(*engine, request, listener,
                     [&](const Recorder& recorder, OpenRig&) { judge(judged, recorder); });
    judged.outcome = result.outcome;
    judged.said += result.reason;
    return judged;
  }
  Judged by_pose(const std::string& fault, const std::string& law = "estimator", int turns = 4,
                 std::uint64_t seed = 1) {
    std::string body = kGo;
    const auto put = [&body](const std::string& name, const std::string& value) {
      body.replace(body.find(name), name.size(), value);
    };
    put("%LAW%", law);
    put("%TURNS%", std::to_string(turns));
    return run(kPose, body, fault, seed);
  }
  /// The promise of docs/reliability.md.
  static void expect_trusted_or_zero(const Judged& judged, const std::string& cause) {
    const bool right = judged.error <= 0.2e-3 && judged.settled <= kOnItsWay;
    if (right && judged.outcome == Outcome::completed) return;
    EXPECT_LE(judged.zero, 1.3) << "lost_timeout and 0.3 s; " << judged.error * 1e3 << " mm, "
                                << judged.settled * 1e3 << " mm\n"
                                << judged.said;
    EXPECT_TRUE(judged.says(cause)) << cause << "\n" << judged.said;
    EXPECT_NE(judged.outcome, Outcome::completed) << judged.said;
  }

  TemporaryFolder folder;
  SilentListener listener;
  std::unique_ptr<ScriptEngine> engine = make_lua_engine({VITREO_SOURCE_DIR "/scripts"});
};

TEST_F(TrustTest, AClockThatLeapsUnderWayIsRightOrNamedAndZero) {
  for (const char* law : {"estimator", "pd"})
    for (const int ms :
         {-600, -300, -100, -60, -20, -8, 8, 20, 60, 80, 82, 90, 98, 100, 101, 300, 600}) {
      SCOPED_TRACE(std::string(law) + " " + std::to_string(ms));
      expect_trusted_or_zero(
          by_pose("pose_sensor:jump:after=6.2s,by=" + std::to_string(ms) + "ms", law),
          "pose_sensor: its time stamps");
    }
}

TEST_F(TrustTest, AClockThatDriftsIsRightOrNamedAndZero) {
  for (const char* by : {"0.02", "-0.02", "0.005", "-0.005", "0.2", "-0.2"}) {
    SCOPED_TRACE(by);
    const Judged judged = by_pose(std::string("pose_sensor:drift:after=6.2s,by=") + by);
    if (judged.outcome == Outcome::completed) {
      EXPECT_LE(judged.error, 0.2e-3);
      EXPECT_LE(judged.settled, 0.25e-3);
    } else {
      EXPECT_LE(judged.error, 0.2e-3) << "until it was told";
      EXPECT_TRUE(judged.says("its clock was set, or drifts")) << judged.said;
    }
  }
}

TEST_F(TrustTest, ReadingsThatAreRepeatedAreNamedAndZero) {
  expect_trusted_or_zero(by_pose("pose_sensor:alternating:after=6.2s"), "its places repeat");
  expect_trusted_or_zero(by_pose("pose_sensor:frozen:after=6.2s"), "stands still");
}

// Found by the soak (seed 2934): the sensor repeats an old place with new noise, the robot is put
// elsewhere, and a loop begins on it.
TEST_F(TrustTest, ALoopThatBeginsOnAnOldPlaceIsAtZeroInTime) {
  constexpr const char* kBegin = R"(
rig.sample:insert_robot { 0, 0, 0.3*mm }
do
  local servo <close> = rig:servo { feedback = "pose_sensor", law = "estimator" }
  servo:wait_until_tracked { timeout = 5*s }
  servo:hold { 0, 0, 0.3*mm }
  run:wait(5*s - run:now())
end
rig.sample:insert_robot { 2*mm, 0, 1*mm }
local servo <close> = rig:servo { feedback = "pose_sensor", law = "estimator" }
servo:wait_until_tracked { timeout = 5*s }
local there, why = pcall(servo.go_to, servo, { 2*mm, 0, 1*mm }, { timeout = 5*s })
if not there then
  run:wait(0.5*s) -- whether the coils stay at zero
  error(why, 0)
end
)";
  const Judged judged = run(kPose, kBegin, "pose_sensor:stale:after=5s");
  EXPECT_LE(judged.zero, 1.3) << judged.said;
  EXPECT_TRUE(judged.says("stands where it is seen")) << judged.said;
  EXPECT_NE(judged.outcome, Outcome::completed) << judged.said;
}

// Found by the soak (seeds 7343, 8206, 8871): an old place, with new noise, while the robot is on a
// short way or at its end. In the second form the law tells the little that is missing again and
// again, and what it tells bends no sooner.
TEST_F(TrustTest, AnOldPlaceOnAShortWayIsFound) {
  constexpr const char* kShort = R"(
local servo <close> = rig:servo { feedback = "pose_sensor", law = "estimator" }
servo:hold { 2*mm, 0, 1*mm }
rig.sample:insert_robot { 1.8*mm, 0, 1*mm }
servo:wait_until_tracked { timeout = 5*s }
run:wait(3*s)
local way = { vector(2*mm, 0, 1*mm), vector(2.3*mm, 0, 1*mm), vector(2*mm, 0, 1*mm) }
for _ = 1, 6 do
  local there, why = pcall(servo.follow, servo, way, { speed = 2*mm/s })
  if not there then
    run:wait(0.5*s) -- whether the coils stay at zero
    error(why, 0)
  end
end
)";
  for (const auto& [fault, bound] : {std::pair("pose_sensor:stale:after=3.3s", 1.3),
                                     std::pair("pose_sensor:stale:after=400ms", 2.0)}) {
    const Judged judged = run(kPose, kShort, fault);
    EXPECT_LE(judged.zero, bound) << fault << "\n" << judged.said;
    EXPECT_TRUE(judged.says("stands where it is seen")) << fault << "\n" << judged.said;
    EXPECT_NE(judged.outcome, Outcome::completed) << fault << "\n" << judged.said;
  }
}

TEST_F(TrustTest, CoilsThatGiveNothingAreNamedWithinASecondAtRestAndSoonerUnderWay) {
  for (const char* law : {"estimator", "pd"})
    for (const char* fault :
         {"coils:cut_off:after=4s", "coils:saturated:after=4s,by=0A", "coils:cut_off:after=6.6s"}) {
      SCOPED_TRACE(std::string(law) + " " + fault);
      const Judged judged = by_pose(fault, law);
      EXPECT_EQ(judged.outcome, Outcome::aborted) << judged.said;
      EXPECT_TRUE(judged.says("the amplifiers give nothing")) << judged.said;
      EXPECT_LE(judged.zero, 1.0);
    }
}

TEST_F(TrustTest, AHealthyMachineIsNotAccused) {
  for (std::uint64_t seed = 1; seed <= 6; ++seed)
    for (const char* law : {"estimator", "pd"}) {
      const Judged judged = by_pose("", law, 4, seed);
      EXPECT_EQ(judged.outcome, Outcome::completed) << law << " " << seed << "\n" << judged.said;
    }
}

// Half and twice the drag, a third more moment, round a square at 2 mm/s: what it was off by on one
// side is no drift that goes on on the next.
TEST_F(TrustTest, AMachineWithAnotherResponseIsNotAccused) {
  constexpr const char* kSquare = R"(
local paths = require "paths"
local corners = paths.rectangle { width = 3*mm, depth = 3*mm, center = vector(0, 0, 0.6*mm) }
local servo <close> = rig:servo { feedback = "pose_sensor", law = "%LAW%" }
servo:hold(corners[1])
rig.sample:insert_robot(corners[1])
servo:wait_until_tracked { timeout = 5*s }
servo:follow(corners, { speed = 2*mm/s })
run:wait(1*s)
)";
  for (const char* truth :
       {"medium = { kinematic_viscosity = 250e-6, density = 970 }",
        "medium = { kinematic_viscosity = 1000e-6, density = 970 }", "robot = { moment = 1.3 }"})
    for (const char* law : {"estimator", "pd"}) {
      std::string body = kSquare;
      body.replace(body.find("%LAW%"), 5, law);
      const std::string rig =
          "\nreturn { title = \"another response\", coils = {}, pose_sensor = {}, sample = {},\n"
          "  truth = { " +
          std::string(truth) + " } }\n";
      for (const std::uint64_t seed : {9301, 9302}) {
        const Judged judged = run(rig, body, "", seed);
        EXPECT_EQ(judged.outcome, Outcome::completed) << truth << " " << law << " " << seed << "\n"
                                                      << judged.said;
      }
    }
}

TEST_F(TrustTest, AChannelThatThereIsNotIsRefused) {
  const Judged judged = by_pose("coils:weak:after=1s,channel=9");
  EXPECT_NE(judged.outcome, Outcome::completed);
  EXPECT_TRUE(judged.says("channel: there are 1 to 8")) << judged.said;
}

TEST_F(TrustTest, CurrentsOfAScriptAreHeldForTheirTimeAndNoLonger) {
  const char* const body = R"(
rig.coils:set_currents({ 1, 0, 0, 0, 0, 0, 0, 0 }, { hold = 2*s })
run:wait(1.9*s)
assert(rig.coils:currents()[1] == 1)
run:wait(0.3*s)
assert(rig.coils:currents()[1] == 0)
)";
  TemporaryFolder own;
  const auto protocol = own.path() / "p.lua";
  std::ofstream(protocol)
      << "local s = require('units').s\nreturn { title = 't', needs = { 'coils' "
         "}, run = function(rig, p, run)\n"
      << body << "\nend }";
  const auto rig = own.path() / "rig.lua";
  std::ofstream(rig) << kPose;
  RunRequest request;
  request.what.protocol_file = protocol.string();
  request.where.rig_file = rig.string();
  request.where.out = (own.path() / "runs").string();
  std::string events;
  run_protocol(*engine, request, listener, [&](const Recorder& recorder, OpenRig&) {
    for (const Event& event : recorder.events()) events += event.kind + ": " + event.text + "\n";
  });
  EXPECT_NE(events.find("dead-man: the currents were to be held for 2 s"), std::string::npos)
      << events;
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
