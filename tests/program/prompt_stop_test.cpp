// Stops at the prompt: in a statement and between two, by whom, and what they leave flowing.
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"
#include "tests/program/terminal.h"

#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <cstdio>
#include <future>
#include <optional>
#include <thread>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

constexpr const char* kCtrlC = "\x03";
/// What the terminal says of a stop by Ann; an abort may be "aborted".
constexpr const char* kByAnn = "by Ann; the devices are safe";
constexpr const char* kSafe = "; the devices are safe";

/// flows() says whether a current flows, push() lets one flow that nothing else takes away in time.
/// No word that the tests wait for is in these lines as they are typed, nor is the prompt.
constexpr const char* kDefinitions[] = {
    "function flows() local t = 0 for _, i in ipairs(rig.coils:currents()) do "
    "t = t + math.abs(i) end print('cur' .. 'rents ' .. (t == 0 and 'zero' or 'flowing')) end",
    "function push() rig.coils:enable() "
    "rig.coils:set_currents({ 2, 0, 0, 0, 0, 0, 0, 0 }, { hold = 60 * s }) end",
    "function waits() print('wai' .. 'ting') run:wait(60 * s) end",
    "function hold() rig.coils:enable() servo = rig:servo { feedback = 'pose_sensor' } "
    "servo:wait_until_tracked() end"};

std::size_t count(const std::string& text, const std::string& part) {
  std::size_t found = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1))
    ++found;
  return found;
}

/// A prompt on a terminal whose control socket is the work place's own, so that `vitreo control`
/// finds it and no other test's run.
class PromptStop : public ::testing::Test {
 protected:
  void begin() {
    const char* before = std::getenv("XDG_RUNTIME_DIR");
    const std::optional<std::string> kept =
        before == nullptr ? std::nullopt : std::optional<std::string>(before);
    setenv("XDG_RUNTIME_DIR", place_.folder().c_str(), 1);
    terminal_.emplace(place_.folder(), "", static_cast<unsigned short>(300));
    if (kept)
      setenv("XDG_RUNTIME_DIR", kept->c_str(), 1);
    else
      unsetenv("XDG_RUNTIME_DIR");
    ASSERT_TRUE(terminal_->prompts()) << unseen();
    for (const char* line : kDefinitions) enter(line);
  }
  /// A loop that holds the robot, which is there from now on.
  void begin_holding() {
    begin();
    enter("rig.sample:insert_robot(vector(0, 0, 0))");
    enter("hold()");
    ASSERT_TRUE(flows());
  }

  void type(const std::string& keys) const { terminal_->type(keys); }
  void enter(const std::string& line) {
    type(line + "\r");
    EXPECT_TRUE(terminal_->prompts()) << line << ": " << unseen();
  }
  /// Begins a statement that lasts a minute.
  void wait_in_a_statement() {
    type("waits()\r");
    ASSERT_TRUE(terminal_->sees("waiting")) << unseen();
  }
  bool sees(const std::string& text, std::chrono::seconds patience = 10s) {
    return terminal_->sees(text, patience);
  }
  std::string unseen() const { return terminal_->unseen(); }

  /// "zero" or "flowing", which shows that the prompt answers, too; else what was seen.
  std::string currents() {
    terminal_->take_unseen();
    type("flows()\r");
    const std::size_t before = terminal_->screen().size();
    const bool answered = sees("currents ") && terminal_->prompts();
    const std::string said = terminal_->screen().substr(before);
    for (const char* word : {"zero", "flowing"})
      if (answered && said.find(std::string("currents ") + word) != std::string::npos) return word;
    return "no answer: " + said;
  }

  /// A current flows; or the machine was so busy that the interlock has taken it away, rightly.
  bool flows() {
    const std::string said = currents();
    const bool late = terminal_->screen().find("the host has not moved for") != std::string::npos;
    EXPECT_TRUE(said == "flowing" || late) << said;
    return said == "flowing" || late;
  }

  /// Another process asks for `word` as Ann.
  std::string control(const std::string& word) const {
    const Spoken spoken = place_.vitreo("control " + word + " --operator Ann");
    EXPECT_EQ(spoken.exit_code, 0) << word << ": " << spoken.err;
    return spoken.out;
  }

  /// Ends the session as its user would, and gives its record as JSON.
  std::string leave() {
    type("exit\r");
    EXPECT_EQ(terminal_->end(), 0) << unseen();
    return record();
  }
  std::string record() const {
    EXPECT_EQ(place_.vitreo("verify last").exit_code, 0) << place_.read("out");
    return place_.vitreo("show last --json").out;
  }

  const Workplace place_;
  std::optional<Terminal> terminal_;
};

TEST_F(PromptStop, CtrlCAndTheScriptsOwnStopEndTheStatementAndTheLoopGoesOnHolding) {
  begin_holding();
  for (const std::string way : {"Ctrl-C", "run:stop()"}) {
    if (way == "Ctrl-C") {
      wait_in_a_statement();
      type(kCtrlC);
    } else {
      type("run:stop('enough')\r");
    }
    EXPECT_TRUE(sees("stopped")) << way << ": " << unseen();
    EXPECT_FALSE(sees("devices are safe", 1s)) << way;
    EXPECT_TRUE(flows()) << way;
  }
  // A line that is given up is none that was sent, and no empty one.
  type(std::string("half a line (") + kCtrlC);
  EXPECT_TRUE(sees("^C")) << unseen();
  EXPECT_FALSE(sees("devices are safe", 1s));
  EXPECT_TRUE(flows());
}

TEST_F(PromptStop, TheSecondCtrlCMakesTheDevicesSafeAndSoDoesAnyOnAnEmptyLineWhileACurrentFlows) {
  begin_holding();
  wait_in_a_statement();
  type(kCtrlC);
  std::this_thread::sleep_for(150ms);  // as fast as a hand; it may still be in the statement
  type(kCtrlC);
  EXPECT_TRUE(sees("devices are safe")) << "in a hurry: " << unseen();
  EXPECT_EQ(currents(), "zero");

  enter("push()");
  ASSERT_TRUE(flows());
  wait_in_a_statement();
  type(kCtrlC);
  EXPECT_TRUE(sees("stopped") && terminal_->prompts()) << unseen();
  EXPECT_TRUE(flows());
  type(kCtrlC);
  EXPECT_TRUE(sees(kSafe)) << "on an empty line: " << unseen();
  EXPECT_EQ(currents(), "zero");
  type(kCtrlC);
  EXPECT_FALSE(sees("devices are safe", 1s)) << "nothing flows";
  EXPECT_GE(count(leave(), "\"kind\":\"stop\""), 1U);
}

// A clean-up in the statement tells in which order it goes.
TEST_F(PromptStop, AnotherOnesStopInAStatementEndsItAndThenMakesTheDevicesSafe) {
  begin_holding();
  wait_in_a_statement();
  control("stop");
  EXPECT_TRUE(sees("stopped by Ann; the devices are safe")) << unseen();
  EXPECT_EQ(currents(), "zero") << "a loop held";

  enter("push()");
  type("do local cleans <close> = setmetatable({}, { __close = flows }) waits() end\r");
  ASSERT_TRUE(sees("waiting")) << unseen();
  control("stop");
  EXPECT_TRUE(sees("currents flowing")) << "the clean-up has the full API: " << unseen();
  EXPECT_TRUE(sees("stopped by Ann; the devices are safe")) << unseen();
  EXPECT_EQ(currents(), "zero");

  for (const char* tier : {"abort", "emergency"}) {
    enter("hold()");
    EXPECT_TRUE(flows()) << tier;
    wait_in_a_statement();
    type(kCtrlC);  // what the operator ended before is forgotten
    EXPECT_TRUE(sees("stopped") && terminal_->prompts()) << unseen();
    wait_in_a_statement();
    control(tier);
    EXPECT_TRUE(sees(kByAnn)) << tier << ": " << unseen();
    EXPECT_EQ(currents(), "zero") << tier << ", said to be safe";
  }

  enter("push()");
  EXPECT_TRUE(flows());
  wait_in_a_statement();
  kill(terminal_->child(), SIGINT);  // from another process too it is Ctrl-C
  EXPECT_TRUE(sees("stopped") && terminal_->prompts()) << unseen();
  EXPECT_TRUE(flows());
}

// Before 2026-11-30 it was without effect, with 2 A in the coils.
TEST_F(PromptStop, BetweenTwoStatementsAStopOfAnyTierMakesTheDevicesSafeAndIsInTheRecord) {
  begin();
  for (const std::string tier : {"stop", "abort", "emergency"}) {
    enter("push()");
    EXPECT_TRUE(flows()) << tier;
    const auto begun = std::chrono::steady_clock::now();
    auto asked = std::async(std::launch::async, [this, tier] { return control(tier); });
    EXPECT_TRUE(sees(kByAnn)) << tier << ": " << unseen();
    std::printf("%s: %d ms from the command's start to the words\n", tier.c_str(),
                static_cast<int>((std::chrono::steady_clock::now() - begun) / 1ms));
    EXPECT_EQ(currents(), "zero") << tier;
    asked.wait();
  }
  enter("push()");
  kill(terminal_->child(), SIGINT);
  EXPECT_TRUE(sees(kSafe)) << "a signal of another: " << unseen();
  EXPECT_EQ(currents(), "zero");
  const std::string json = leave();
  EXPECT_EQ(count(json, "\"kind\":\"stop\""), 4U) << json.substr(json.find("\"events\""), 4000);
}

TEST_F(PromptStop, AfterAStopBetweenTwoTheLoopIsGoneAndANewOneHolds) {
  begin_holding();
  EXPECT_TRUE(control("status").starts_with("ready"))
      << "while a loop holds: " << place_.read("out");
  control("stop");
  EXPECT_TRUE(sees("stopped by Ann; the devices are safe")) << unseen();
  EXPECT_EQ(currents(), "zero");
  EXPECT_TRUE(control("status").starts_with("ready")) << "after a stop: " << place_.read("out");
  enter("hold()");
  EXPECT_TRUE(flows());
  wait_in_a_statement();
  const std::string status = control("status");
  EXPECT_EQ(status.find("ready"), std::string::npos) << status;
  EXPECT_NE(status.find("run:wait"), std::string::npos) << status;
  type(kCtrlC);
  EXPECT_TRUE(sees("stopped") && terminal_->prompts()) << unseen();
  leave();
}

TEST_F(PromptStop, TheWordsOfAStopStandAboveTheLineThatIsTyped) {
  begin();
  enter("push()");
  type("20 +");
  ASSERT_TRUE(sees("20 +")) << unseen();
  control("stop");
  EXPECT_TRUE(sees("stopped by Ann; the devices are safe")) << unseen();
  EXPECT_TRUE(sees("20 +")) << "the line is drawn again: " << unseen();
  type(" 22\r");
  EXPECT_TRUE(sees("\r42\r\n") && terminal_->prompts()) << unseen();
  EXPECT_EQ(currents(), "zero");
}

// Before 2026-11-30 the watchdog ended a prompt that stood idle 5 s after that.
TEST_F(PromptStop, APromptThatStandsIdleAfterAnAbortedStatementIsNotEnded) {
  begin();
  enter("push()");
  wait_in_a_statement();
  control("abort");
  EXPECT_TRUE(sees("devices are safe")) << unseen();
  EXPECT_FALSE(sees("not responding", 7s)) << "nothing is typed";
  EXPECT_EQ(currents(), "zero");
  leave();
}

TEST_F(PromptStop, SigtermAndSighupMakeTheDevicesSafeAndEndTheSessionInOrder) {
  for (const int number : {SIGTERM, SIGHUP})
    for (const bool in_statement : {false, true}) {
      SCOPED_TRACE(std::string(number == SIGTERM ? "SIGTERM" : "SIGHUP") +
                   (in_statement ? " in a statement" : " between two"));
      std::filesystem::remove_all(place_.folder() / "runs");
      ASSERT_NO_FATAL_FAILURE(begin());
      enter("push()");
      EXPECT_TRUE(flows());
      if (in_statement) wait_in_a_statement();
      kill(terminal_->child(), number);
      const int code = terminal_->end();
      EXPECT_EQ(code, 3) << unseen();
      EXPECT_NE(unseen().find("the devices are safe"), std::string::npos) << unseen();
      if (code < 0) continue;  // it goes on: there is no end record yet
      const std::string json = record();
      EXPECT_NE(json.find("\"coils_at_end\":\"coils set to 0 A"), std::string::npos) << json;
      if (!in_statement) {
        EXPECT_EQ(count(json, "\"kind\":\"stop\""), 1U) << json;
      }
      const std::string runs = place_.vitreo("runs --json").out;
      EXPECT_EQ(count(runs, "\"outcome\":"), 1U) << runs;
      EXPECT_NE(runs.find("\"outcome\":\"stopped\""), std::string::npos) << runs;
    }
}

// The stop is asked while the line lies in the terminal and the program does not run, as on a busy
// machine, and then at moments about that at which the line is sent: before, the statement runs;
// after, it is ended; and the stop has its effect in each case.
TEST_F(PromptStop, WhatIsAskedInTheMomentInWhichALineIsSentIsNotLost) {
  begin();
  for (int trial = 0; trial < 3; ++trial) {
    enter("push()");
    const std::size_t before = terminal_->screen().size();
    kill(terminal_->child(), SIGSTOP);
    type("print('be' .. 'gun') run:wait(5 * s) print('who' .. 'le')\r");
    auto asked = std::async(std::launch::async, [this] { return control("stop"); });
    std::this_thread::sleep_for(100ms);  // the interlock wants the program to move each 250 ms
    kill(terminal_->child(), SIGCONT);
    EXPECT_TRUE(sees(kByAnn)) << "held up, trial " << trial << ": " << unseen();
    asked.wait();
    EXPECT_EQ(currents(), "zero") << "held up, trial " << trial;
    const std::string since = terminal_->screen().substr(before);
    EXPECT_EQ(count(since, "whole"), 0U)
        << "the line was sent before the stop was asked, trial " << trial << ": " << since;
    std::printf("held up, trial %d: %s\n", trial, count(since, "begun") ? "begun" : "never begun");
  }
  int never_begun = 0, ended = 0, ran = 0;
  for (const auto delay : {0ms, 10ms, 20ms, 30ms, 45ms}) {
    enter("push()");
    const std::string before = terminal_->screen();
    type("print('be' .. 'gun') run:wait(0.8 * s) print('who' .. 'le')");
    auto asked = std::async(std::launch::async, [this] { return control("stop"); });
    std::this_thread::sleep_for(delay);
    type("\r");
    EXPECT_TRUE(sees(kByAnn)) << delay.count() << " ms: " << unseen();
    asked.wait();
    EXPECT_EQ(currents(), "zero") << delay.count() << " ms";
    const std::string since = terminal_->screen().substr(before.size());
    ++(count(since, "whole") != 0 ? ran : count(since, "begun") != 0 ? ended : never_begun);
  }
  std::printf("about the moment: %d never begun, %d ended, %d ran before or after the stop\n",
              never_begun, ended, ran);
  leave();
}

// There the prompt does not come, so the watchdog does it, after 0.25 s. On the virtual clock: at
// the pace of the wall clock the host's dead-man would take the current away without a stop. What
// flows while nothing is said cannot be seen from outside; what the next line finds can.
TEST_F(PromptStop, WhereAPipeSaysNothingTheWatchdogMakesTheDevicesSafe) {
  FILE* pipe =
      popen(("cd '" + place_.folder().string() +
             "' && XDG_RUNTIME_DIR=\"$PWD\" HOME=\"$PWD\" '" VITREO_PROGRAM "' >said 2>complaints")
                .c_str(),
            "w");
  ASSERT_NE(pipe, nullptr);
  const auto say = [pipe](const std::string& line) {
    std::fputs((line + "\n").c_str(), pipe);
    std::fflush(pipe);
  };
  const auto said = [this] { return place_.read("said"); };
  const auto comes = [&said](const std::string& text) {
    for (int i = 0; i < 100; ++i, std::this_thread::sleep_for(100ms))
      if (said().find(text) != std::string::npos) return true;
    return false;
  };
  for (const char* line : kDefinitions) say(line);
  say("push() flows()");
  EXPECT_TRUE(comes("currents flowing")) << said() << place_.read("complaints");
  control("stop");
  std::this_thread::sleep_for(1s);
  // The first may be what the stop ends before it begins.
  say("flows()");
  say("flows()");
  say("print('la' .. 'st')");
  EXPECT_TRUE(comes("last")) << "the session goes on: " << place_.read("complaints");
  const int status = pclose(pipe);
  ASSERT_TRUE(WIFEXITED(status));
  const int code = WEXITSTATUS(status);
  EXPECT_TRUE(code == 0 || code == 1 || code == 3) << code;
  EXPECT_EQ(count(said(), "currents flowing"), 1U) << said();
  EXPECT_GE(count(said(), "currents zero"), 1U) << said();
  EXPECT_EQ(count(record(), "\"kind\":\"stop\""), 1U);
  std::printf("exit code %d, errors: %s\n", code, place_.read("complaints").c_str());
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
