// Runs that are paused, stopped, aborted, and that hang: from Lua, through the control socket's
// words, and by force.
// SPDX-License-Identifier: Apache-2.0
#include "tests/host/lua/run/run_control_bench.h"

#include <array>
#include <memory>
#include <sys/socket.h>
#include <sys/un.h>
#include <thread>
#include <unistd.h>

namespace vitreo {
namespace VITREO_TEST_FILE {

constexpr const char* kEnergized = "rig.coils:set_currents { 2, 2, 2, 2, 2, 2, 2, 2 }\n";

TEST_F(RunControlTest, AScriptThatStopsItselfIsStoppedWithItsReason) {
  const RunResult result = run(std::string(kEnergized) +
                               "run:defer(function() run:wait(1*s) print('cleaned') end)\n"
                               "pcall(function() run:stop('enough') end)\nprint('not reached')");
  EXPECT_EQ(result.outcome, Outcome::stopped);
  EXPECT_EQ(result.reason, "stopped by the script: enough");
  EXPECT_EQ(ear.said, "cleaned;");
}

TEST_F(RunControlTest, AnAbortMakesTheCoilsSafeBeforeTheScriptsCleanUpAndRefusesThemInIt) {
  const RunResult result =
      run(std::string(kEnergized) +
          "run:defer(function()\n"
          "  print(rig.coils:currents()[1])\n"
          "  print(pcall(function() rig.coils:set_currents { 1, 1, 1, 1, 1, 1, 1, 1 } end))\n"
          "end)\nrun:abort()");
  EXPECT_EQ(result.outcome, Outcome::aborted);
  EXPECT_EQ(result.exit_code, ExitCode::aborted);
  EXPECT_TRUE(ear.said.starts_with("0.0;false")) << ear.said;
}

TEST_F(RunControlTest, TheCleanUpAfterAStopHasABudgetOfFiveSeconds) {
  const RunResult result = run(
      "run:defer(function() print('second') run:wait(1*s) print('not reached') end)\n"
      "run:defer(function() print('first') run:wait(100*s) print('not reached') end)\nrun:stop()");
  EXPECT_EQ(result.outcome, Outcome::stopped);
  EXPECT_EQ(ear.said, "first;second;");
  EXPECT_NEAR(experiment_time, 5, 0.5) << "s";
}

TEST_F(RunControlTest, AnAbortOfTheCleanUpCutsItShort) {
  ear.on_message = [](const std::string& line) {
    if (line == "clean") attached_control()->request(StopTier::abort);
  };
  const RunResult result = run(
      "run:defer(function() print('clean') run:wait(4*s) print('not reached') end)\nrun:stop()");
  EXPECT_EQ(result.outcome, Outcome::aborted);
  EXPECT_EQ(ear.said, "clean;");
  EXPECT_LT(experiment_time, 1.5);
}

TEST_F(RunControlTest, AnEmergencyStopRunsNoCleanUpAndSaysSo) {
  ear.on_message = [](const std::string&) { attached_control()->request(StopTier::emergency); };
  const RunResult result =
      run(std::string(kEnergized) +
          "run:defer(function() print('cleaned') end)\nprint('now')\nrun:wait(100*s)");
  EXPECT_EQ(result.outcome, Outcome::aborted);
  EXPECT_EQ(ear.said, "now;");
  EXPECT_NE(events.find("1 deferred function(s) of the script were not called"), std::string::npos)
      << events;
}

TEST_F(RunControlTest, ARequestFromAnotherThreadEndsAnEndlessLoopOfPlainLua) {
#ifdef __SANITIZE_THREAD__
  GTEST_SKIP()
      << "the thread sanitizer keeps signals back until a call that blocks; this loop has none";
#endif
  std::thread other;
  ear.on_message = [&](const std::string&) {
    if (!other.joinable()) other = std::thread([this] { say("stop"); });
  };
  const RunResult result =
      run("print('now')\nwhile true do pcall(function() while true do end end) end");
  other.join();
  EXPECT_EQ(result.outcome, Outcome::stopped);
  EXPECT_EQ(reply["status"]["phase"], "stop requested") << "requested is not stopped";
}

/// The run's own control socket, as `vitreo control` speaks to it; other tests have theirs at the
/// same time.
std::string control(const std::filesystem::path& runs, const nlohmann::json& request) {
  const std::string name = std::filesystem::directory_iterator(runs)->path().filename().string();
  const nlohmann::json answer = control_run(name, request);
  return answer["ok"] ? answer["status"]["text"].get<std::string>()
                      : answer["error"].get<std::string>();
}

TEST_F(RunControlTest, AnAlarmIsAcknowledgedThroughTheControlSocketAndThatIsRecorded) {
  ControlFace socket;
  request.how.faces.push_back(&socket);
  std::thread other;
  std::string unknown;
  ear.on_message = [&](const std::string& line) {
    if (!line.starts_with("ALARM")) return;
    other = std::thread([&] {
      unknown = control(folder.path() / "runs", {{"do", "ack"}, {"alarm", "dsik"}});
      control(folder.path() / "runs", {{"do", "ack"}, {"by", "anna"}});
    });
  };
  const RunResult result =
      run("run:alarm({ name = 'coil', priority = 'high', text = 'too hot' }):clear()\n"
          "while #run:alarms() > 0 do run:wait(0.1*s) end");
  other.join();
  EXPECT_EQ(result.outcome, Outcome::completed) << result.reason;
  EXPECT_NE(unknown.find("no alarm 'dsik' stands; there is: coil"), std::string::npos) << unknown;
  EXPECT_NE(
      events.find("alarm:high: coil: too hot;alarm cleared:coil;alarm acknowledged:coil (anna);"),
      std::string::npos)
      << events;
}

TEST_F(RunControlTest, ASuspendedRunGoesOnWhenItIsMendedOrByAnOverrideThatIsRecorded) {
  ControlFace socket;
  request.how.faces.push_back(&socket);
  std::vector<std::thread> others;
  ear.on_message = [&](const std::string& line) {
    const bool first = line == "suspended: dark", again = line.starts_with("still suspended: dark");
    if (first || again)
      others.emplace_back([this, again] {
        control(folder.path() / "runs", {{"do", "resume"}, {"override", again}, {"by", "anna"}});
      });
  };
  const RunResult result =
      run("run:suspend_when('dark', function() return true end)\nrun:checkpoint('a')\nprint('went "
          "on')");
  for (std::thread& other : others) other.join();
  EXPECT_EQ(result.outcome, Outcome::completed) << result.reason;
  EXPECT_TRUE(ear.said.ends_with("went on;")) << ear.said;
  EXPECT_NE(events.find("override:suspended: dark; by anna"), std::string::npos) << events;
  EXPECT_EQ(others.size(), 2u);
}

TEST_F(RunControlTest, AResumeThatComesAsSoonAsASuspensionIsToldIsNotLost) {
  ear.on_message = [this](const std::string& line) {
    if (line.find("suspended: dark") != std::string::npos)
      say("resume", R"("override": )" + std::string(line.starts_with("still") ? "true" : "false"));
  };
  const RunResult result =
      run("run:suspend_when('dark', function() return true end)\nrun:checkpoint('a')\nprint('went "
          "on')");
  EXPECT_EQ(result.outcome, Outcome::completed) << result.reason;
  EXPECT_NE(ear.said.find(";still suspended: dark"), std::string::npos) << ear.said;
  EXPECT_TRUE(ear.said.ends_with("went on;")) << ear.said;
}

TEST_F(RunControlTest, ATechnicianCannotOverrideButStop) {
  RigDescription rig;
  rig.table["rights"].value = ConfigTable{{"anna", ConfigValue{std::string("researcher")}}};
  LoneDesk lone;
  lone.desk.set_rights(Rights::of(rig));
  const nlohmann::json refused =
      answer_request("{\"do\": \"resume\", \"override\": true, \"by\": \"ben\"}", lone.desk);
  EXPECT_NE(refused["error"].get<std::string>().find("ben is a technician here"), std::string::npos)
      << refused;
  EXPECT_EQ(lone.control.take_override(), "");
  EXPECT_TRUE(answer_request("{\"do\": \"stop\", \"by\": \"ben\"}", lone.desk)["ok"]);
  EXPECT_EQ(lone.control.reason(), "by ben");
}

TEST_F(RunControlTest, TheStatusTellsProgressAndAnInterlockThatTripsIsAnAlarm) {
  nlohmann::json status;
  ear.on_message = [&](const std::string& line) {
    if (line == "half") status = (say("status"), reply["status"]);
  };
  run("for i in run:each(4, 'place') do if i == 3 then print('half') end end\n"
      "pcall(function() rig.coils:set_currents { 13, 0, 0, 0, 0, 0, 0, 0 } end)");
  EXPECT_EQ(status["progress"], 0.5);
  EXPECT_EQ(status["doing"], "place 3 of 4");
  EXPECT_NE(events.find("alarm:high: interlock: coil 1: 13 A is beyond the limit"),
            std::string::npos)
      << events;
}

TEST_F(RunControlTest, PausesAtTheCheckpointThatWasNamedAndResumes) {
  std::thread other;
  ear.on_message = [&](const std::string& line) {
    if (line == "start") say("pause", "\"at\": \"b\"");
    if (line.starts_with("paused"))
      other = std::thread([this] {
        say("status");
        std::this_thread::sleep_for(20ms);
        attached_control()->resume();
      });
  };
  const RunResult result =
      run("print('start')\nrun:checkpoint('a')\nprint('after "
          "a')\nrun:checkpoint('b')\nprint('after b')");
  other.join();
  EXPECT_EQ(result.outcome, Outcome::completed) << result.reason;
  EXPECT_EQ(ear.said,
            "start;after a;paused at the checkpoint 'b' (go on: vitreo control resume);after b;");
  EXPECT_EQ(reply["status"]["phase"], "paused");
  EXPECT_EQ(reply["status"]["note"], "b");
  EXPECT_NE(events.find("paused:b;resumed:;"), std::string::npos) << events;
}

TEST_F(RunControlTest, AStopEndsAPausedRun) {
  std::thread other;
  ear.on_message = [&](const std::string& line) {
    if (line.starts_with("paused")) other = std::thread([this] { say("stop"); });
  };
  const RunResult result = run("run:pause()\nrun:checkpoint('a')\nprint('not reached')");
  other.join();
  EXPECT_EQ(result.outcome, Outcome::stopped);
  EXPECT_EQ(ear.said, "paused at the checkpoint 'a' (go on: vitreo control resume);");
}

TEST_F(RunControlTest, AConditionSuspendsAtCheckpointsAndResumesWhereThatIsDeclared) {
  const RunResult result =
      run("local warm = true\n"
          "run:suspend_when('coils too warm', function() return run:now() < 3*s end, { resume = "
          "true })\n"
          "run:checkpoint('a')\nprint(run:now() >= 3*s)");
  EXPECT_EQ(result.outcome, Outcome::completed) << result.reason;
  EXPECT_EQ(ear.said, "suspended: coils too warm;true;");
  EXPECT_NE(events.find("suspended:coils too warm;condition ended:"), std::string::npos) << events;
}

TEST_F(RunControlTest, AConditionThatNeverEndsBecomesAnErrorAfterItsTimeout) {
  const RunResult result =
      run("run:suspend_when('dark', function() return true end, { resume = true, timeout = 20*s "
          "})\nrun:checkpoint('a')");
  EXPECT_EQ(result.outcome, Outcome::failed);
  EXPECT_NE(result.reason.find("suspended for longer than allowed: dark"), std::string::npos)
      << result.reason;
}

TEST_F(RunControlTest, WhatAsksForNoMoreThanWasAskedForDoesNotChangeTheReason) {
  const RunResult result =
      run("run:defer(function() run:stop('again') end)\nrun:defer(function() run:abort('worse') "
          "end)\nrun:stop('first')");
  EXPECT_EQ(result.outcome, Outcome::aborted);
  EXPECT_EQ(result.reason, "aborted by the script: worse");
}

TEST_F(RunControlTest, TheEndRecordSaysAtWhichLineTheScriptWasStoppedOrFailed) {
  const auto place = [this](const std::string& body) {
    run(body);
    return script_place;
  };
  EXPECT_EQ(place("run:wait(1*s)\nrun:stop('enough')"), "protocol.lua:5");
  EXPECT_EQ(place("run:wait(1*s)\nerror('without a place', 0)"), "protocol.lua:5");
  EXPECT_EQ(place("local t = {}\nwhile true do t[#t + 1] = ('x'):rep(1000000) .. #t end"),
            "protocol.lua:5");
  EXPECT_EQ(place("local x <close> = setmetatable({}, { __close = function() run:wait(9*s) end "
                  "})\n\nrun:stop()"),
            "protocol.lua:6");
  EXPECT_EQ(place("run:wait(1*s)"), "");
}

TEST_F(RunControlTest, AStopReachesWhatAnErrorSaysOfItselfAndThatIsBounded) {
  const std::string endless =
      "error(setmetatable({}, { __tostring = function() while true do end end }))";
  RunResult result = run(endless);
  EXPECT_EQ(result.outcome, Outcome::failed);
  EXPECT_NE(result.reason.find("an error that cannot be shown"), std::string::npos)
      << result.reason;
  ear.on_message = [](const std::string&) { attached_control()->request(StopTier::stop); };
  result = run(
      "error(setmetatable({}, { __tostring = function() print('now') while true do end end }))");
  EXPECT_EQ(result.outcome, Outcome::stopped) << result.reason;
}

TEST_F(RunControlTest, FunctionsDeferredWithoutEndAreStoppedAndTakeNoMemory) {
  ear.on_message = [](const std::string&) { attached_control()->request(StopTier::stop); };
  const RunResult result =
      run("local count = 0\nlocal function again()\n  count = count + 1\n"
          "  if count == 30000 then print('many') end\n  run:defer(again)\nend\nrun:defer(again)");
  EXPECT_NE(result.outcome, Outcome::completed);
  EXPECT_EQ(result.reason.find("memory"), std::string::npos) << result.reason;
}

/// `trip` happens in a run that then goes on in one of many ways, and returns.
struct WhatHappened {
  const char* trip;
  const char* reason;
};
constexpr std::array kTrips{
    WhatHappened{"pcall(rig.coils.set_currents, rig.coils, { 99, 0, 0, 0, 0, 0, 0, 0 })",
                 "interlock: "},
    WhatHappened{"pcall(rig.coils.set_currents, rig.coils, { 0, 0, -99, 0, 0, 0, 0, 0 })",
                 "interlock: "},
    WhatHappened{"pcall(rig.coils.set_currents, rig.coils, { 8, 8, 8, 8, 8, 8, 8, 8 })",
                 "interlock: "},
    WhatHappened{
        "rig.sample:remove_robot()\nlocal background = rig:learn_background { frames = 4 }\n"
        "rig.sample:insert_robot { 0, 0, 0 }\n"
        "local servo = rig:servo { background = background }\nservo:hold { 0, 0, 0 }\n"
        "run:wait(1*s)\nrig.simulation:fault('top_camera', 'silent')\nrun:wait(10*s)",
        "interlock: dead-man"},
    WhatHappened{"run:stop('enough')", "stopped "},
    WhatHappened{"run:abort('enough')", "aborted "},
};
/// "@" stands for what trips.
constexpr std::array kWaysToGoOn{
    "@ run:wait(0.1*s)",
    "pcall(function() @ end)",
    "pcall(function() @ end) pcall(rig.coils.set_currents, rig.coils, { 0, 0, 0, 0, 0, 0, 0, 0 })",
    "coroutine.resume(coroutine.create(function() @ end))",
    "pcall(coroutine.wrap(function() @ end))",
    "pcall(run.together, run, function() @ end, function() run:wait(0.1*s) end)",
    "xpcall(function() @ end, function() return 'mine' end)",
    "run:defer(function() @ end)",
    "pcall(function() local x <close> = setmetatable({}, { __close = function() coroutine.yield() "
    "end }) @ end)",
    "coroutine.wrap(function() local x <close> = setmetatable({}, { __close = function() "
    "coroutine.yield() end }) @ end)()",
};

TEST_F(RunControlTest, NothingThatAScriptDoesCompletesARunThatTrippedOrWasStopped) {
  for (const WhatHappened& what : kTrips) {
    for (const char* const way : kWaysToGoOn) {
      std::string body = way;
      body.replace(body.find('@'), 1, what.trip);
      const RunResult result = run(body);
      EXPECT_NE(result.outcome, Outcome::completed) << body;
      EXPECT_NE(result.exit_code, ExitCode::completed) << body;
      EXPECT_TRUE(result.reason.starts_with(what.reason)) << body << ": " << result.reason;
      EXPECT_NE(result.outcome, Outcome::failed) << body << ": " << result.reason;
    }
  }
}

TEST_F(RunControlTest, ATripThatTheScriptAcceptsByNameIsPartOfTheRun) {
  const std::string trip =
      "pcall(rig.coils.set_currents, rig.coils, { 99, 0, 0, 0, 0, 0, 0, 0 })\n";
  const std::string accept = "run:accept('interlock', 'the limit is what this tries')\n";
  EXPECT_EQ(run(trip + accept).outcome, Outcome::completed);
  EXPECT_NE(events.find("accepted:interlock: the limit is what this tries;"), std::string::npos)
      << events;
  EXPECT_EQ(run(accept).outcome, Outcome::failed) << "nothing has tripped";
  EXPECT_EQ(run(trip + "run:accept('interlock', '')").outcome, Outcome::failed);
}

// The refusal says how to go on, and that is an event of the record; the trip stays one.
TEST_F(RunControlTest, AnInterlockThatTrippedIsClosedAgainByAWord) {
  const std::string trip =
      "print(pcall(rig.coils.set_currents, rig.coils, { 99, 0, 0, 0, 0, 0, 0, 0 }))\n"
      "print(pcall(rig.coils.set_currents, rig.coils, { 1, 0, 0, 0, 0, 0, 0, 0 }))\n";
  const RunResult tripped =
      run(trip +
          "rig.coils:enable()\nrig.coils:enable()\nprint('enabled', rig.coils:currents()[1])\n"
          "rig.coils:set_currents { 1, 0, 0, 0, 0, 0, 0, 0 }\n"
          "print('set', rig.coils:currents()[1])");
  EXPECT_NE(ear.said.find("rig.coils:enable() closes it again"), std::string::npos) << ear.said;
  EXPECT_NE(ear.said.find("enabled\t0.0;"), std::string::npos) << ear.said;
  EXPECT_NE(ear.said.find("set\t1.0;"), std::string::npos) << ear.said;
  EXPECT_EQ(tripped.outcome, Outcome::aborted);
  const std::string event = "interlock enabled:coil 1: 99 A is beyond the limit of 12 A";
  EXPECT_NE(events.find(event), std::string::npos) << events;
  EXPECT_EQ(events.find(event), events.rfind(event)) << "of a closed one it is none";
}

// What a stop took to zero, the script's own end does not energize again.
TEST_F(RunControlTest, NoInterlockIsClosedAgainWhileTheRunIsBeingStopped) {
  for (const StopTier tier : {StopTier::stop, StopTier::abort}) {
    const char* const word = tier == StopTier::stop ? "stop" : "abort";
    ear.said.clear();
    ear.on_message = [tier](const std::string& line) {
      if (line == "begun") attached_control()->request(tier);
    };
    const RunResult stopped =
        run("rig.coils:set_currents { 1, 0, 0, 0, 0, 0, 0, 0 }\n"
            "run:defer(function()\n"
            "  pcall(rig.coils.set_currents, rig.coils, { 99, 0, 0, 0, 0, 0, 0, 0 })\n"
            "  print('enable', pcall(rig.coils.enable, rig.coils))\n"
            "  print('set', pcall(rig.coils.set_currents, rig.coils, { 1, 0, 0, 0, 0, 0, 0, 0 }))\n"
            "end)\n"
            "print('begun') run:wait(5 * s)");
    EXPECT_NE(stopped.outcome, Outcome::completed) << word;
    EXPECT_NE(ear.said.find("enable\tfalse"), std::string::npos) << word << ": " << ear.said;
    EXPECT_NE(ear.said.find("set\tfalse"), std::string::npos) << word << ": " << ear.said;
    EXPECT_EQ(events.find("interlock enabled"), std::string::npos) << events;
  }
}

TEST_F(RunControlTest, AStopIsNeverRefusedForItsDecoration) {
  for (const char* line :
       {"{\"do\": \"stop\", \"by\": 5}", "{\"do\": \"stop\", \"positions\": \"junk\"}",
        "{\"do\": \"stop\", \"override\": \"perhaps\", \"more\": [1, {}]}", "stop", " stop\r"}) {
    LoneDesk lone;
    EXPECT_TRUE(answer_request(line, lone.desk)["ok"]) << line;
    EXPECT_EQ(lone.control.tier(), StopTier::stop) << line;
  }
}

TEST_F(RunControlTest, WrongWordsAtTheSocketAreToldInWordsOfOurOwn) {
  LoneDesk lone;
  for (const char* line : {"{\"do\": \"answer\", \"text\": 5}", "{\"do\": \"answer\"}", "{\"do\"",
                           "{\"do\": \"resume\", \"override\": 5}",
                           "{\"do\": \"target\", \"positions\": [[1, 2, \"x\"]]}"}) {
    const nlohmann::json answer = answer_request(line, lone.desk);
    EXPECT_FALSE(answer["ok"]) << line;
    EXPECT_EQ(answer["error"].get<std::string>().find("json"), std::string::npos) << answer;
  }
}

/// A connection that never says a word.
class SilentClient {
 public:
  explicit SilentClient(const std::filesystem::path& path)
      : socket_(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    path.string().copy(address.sun_path, sizeof(address.sun_path) - 1);
    EXPECT_EQ(::connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof(address)), 0);
  }
  ~SilentClient() { ::close(socket_); }
  SilentClient(const SilentClient&) = delete;
  SilentClient& operator=(const SilentClient&) = delete;

 private:
  int socket_;
};

TEST_F(RunControlTest, HundredsOfSilentClientsDoNotShutAStopOut) {
  const std::string name = "door_" + std::to_string(::getpid());
  LoneDesk lone;
  const ControlSocket socket(control_socket_path(name), lone.desk);
  std::vector<std::unique_ptr<SilentClient>> silent;
  for (int i = 0; i < 500; ++i) {
    silent.push_back(std::make_unique<SilentClient>(control_socket_path(name)));
    if (i % 100 == 0) {
      EXPECT_TRUE(control_run(name, {{"do", "status"}})["ok"]) << i;
    }
  }
  EXPECT_TRUE(control_run(name, {{"do", "stop"}})["ok"]);
  EXPECT_EQ(lone.control.tier(), StopTier::stop);
}

TEST_F(RunControlTest, RequestsThatMakeNoSenseAreRefusedByName) {
  LoneDesk lone;
  EXPECT_FALSE(answer_request("{\"do\": \"dance\"}", lone.desk)["ok"]);
  EXPECT_FALSE(answer_request("junk \xff", lone.desk)["ok"]);
  EXPECT_FALSE(answer_request("[]", lone.desk)["ok"]);
  EXPECT_FALSE(answer_request("{\"do\": 7}", lone.desk)["ok"]);
  EXPECT_FALSE(answer_request("{\"do\": \"answer\", \"text\": \"x\"}", lone.desk)["ok"])
      << "none is open";
  EXPECT_EQ(lone.control.tier(), StopTier::none);
}

/// A call into the host that no hook reaches: the listener of messages does not come back.
constexpr const char* kStuck = "print('stuck')";

TEST_F(RunControlTest, AScriptStuckInACallOfCLosesTheCoilsAndThenTheProcess) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  request.how.watchdog = {100ms, 50ms, 400ms};
  EXPECT_EXIT(
      {
        ear.on_message = [](const std::string& line) {
          attached_control()->request(StopTier::stop);
          while (line == "stuck") ::pause();
        };
        run(std::string(kEnergized) + "run:defer(function() " + kStuck + " end)\nprint('now')\n" +
            kStuck);
      },
      testing::ExitedWithCode(static_cast<int>(ExitCode::not_responding)),
      "not responding: the script was stuck");
}

TEST_F(RunControlTest, AScriptThatComesBackWithinTheGraceEndsInOrderWithTheCoilsAlreadySafe) {
  request.how.watchdog = {10ms, 10ms, 60s};
  ear.on_message = [](const std::string& line) {
    if (line != "now") return;
    attached_control()->request(StopTier::abort);
    while (!attached_control()->safe()) ::usleep(1000);
    ::usleep(200'000);  // the watchdog has begun to make safe: this call outlasts it
  };
  const RunResult result = run(std::string(kEnergized) +
                               "run:defer(function() print(rig.coils:currents()[1]) "
                               "end)\nprint('now')");
  EXPECT_EQ(result.outcome, Outcome::aborted);
  EXPECT_EQ(ear.said, "now;0.0;");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
