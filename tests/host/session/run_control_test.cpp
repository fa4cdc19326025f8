// Run control by itself: tiers, reasons, causes, the safe state, and what the faces are shown.
// SPDX-License-Identifier: Apache-2.0
#include "host/session/run_control.h"

#include <gtest/gtest.h>

#include <csignal>
#include <cstdlib>
#include <string>
#include <thread>
#include <unistd.h>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

struct RunControlUnit : testing::Test {
  void SetUp() override {
    unsetenv("SLURM_JOB_ID");
    control.attach({[this] { ++interrupted; },
                    [this] {
                      ++made_safe;
                      return std::vector<std::string>{"lamp: is gone"};
                    }});
  }
  RunControl control;
  int interrupted = 0;
  int made_safe = 0;
};

TEST_F(RunControlUnit, ARequestRaisesTheTierAndNeverLowersIt) {
  EXPECT_EQ(control.tier(), StopTier::none);
  for (const StopTier tier : {StopTier::stop, StopTier::abort, StopTier::emergency}) {
    control.request(tier);
    EXPECT_EQ(control.tier(), tier);
  }
  control.request(StopTier::stop);
  EXPECT_EQ(control.tier(), StopTier::emergency);
  EXPECT_EQ(interrupted, 3) << "a lower one changes nothing";
  EXPECT_EQ(RunControl::next(StopTier::none), StopTier::stop);
  EXPECT_EQ(RunControl::next(StopTier::stop), StopTier::abort);
  EXPECT_EQ(RunControl::next(StopTier::abort), StopTier::abort);
}

TEST_F(RunControlUnit, EachTiersDeadlineBeginsWithItsFirstRequest) {
  EXPECT_FALSE(control.since(StopTier::stop));
  control.request(StopTier::stop);
  const auto requested = Clock::now();  // no earlier than the request's own time
  ASSERT_TRUE(control.since(StopTier::stop));
  EXPECT_FALSE(control.since(StopTier::abort));
  while (Clock::now() - requested < 3ms) std::this_thread::yield();
  control.request(StopTier::stop);
  EXPECT_GE(*control.since(StopTier::stop), 3ms) << "a second request does not begin it anew";
  control.request(StopTier::abort);
  const auto since_abort = control.since(StopTier::abort);  // first: the clock goes on
  ASSERT_TRUE(since_abort);
  EXPECT_LT(*since_abort, *control.since(StopTier::stop));
  EXPECT_FALSE(control.since(StopTier::emergency));
  RunControl other;
  other.request(StopTier::abort);
  EXPECT_TRUE(other.since(StopTier::stop)) << "an abort is a stop too";
  EXPECT_LT(*other.since(StopTier::stop), 10s);
}

TEST_F(RunControlUnit, TheFirstWhoAsksForATierIsItsReasonAndCause) {
  EXPECT_EQ(control.reason(), "by the operator");
  EXPECT_EQ(control.cause().by, "person");
  control.request(StopTier::stop, "because the disk is full", {"disk"});
  control.request(StopTier::stop, "because of something later", {"later"});
  EXPECT_EQ(control.reason(), "because the disk is full");
  EXPECT_EQ(control.cause().by, "disk");
  control.request(StopTier::abort, "because the coils do not answer", {"interlock"});
  EXPECT_EQ(control.reason(), "because the coils do not answer");
  EXPECT_EQ(control.cause().by, "interlock");
}

TEST_F(RunControlUnit, ASignalSaysWhoseItIs) {
  control.request_by_signal(SIGTERM, 0, StopTier::stop);
  EXPECT_EQ(control.cause().by, "signal");
  EXPECT_EQ(control.cause().signal, "SIGTERM");
  EXPECT_EQ(control.reason(), "by SIGTERM");
  control.request_by_signal(SIGHUP, 0, StopTier::abort);
  EXPECT_EQ(control.cause().signal, "SIGTERM") << "the first one";
  const std::vector<std::pair<int, std::string>> signals{
      {SIGHUP, "SIGHUP"}, {SIGQUIT, "SIGQUIT"}, {SIGUSR2, "a signal"}};
  for (const auto& [number, name] : signals) {
    RunControl one;
    one.request_by_signal(number, 0, StopTier::stop);
    EXPECT_EQ(one.cause().signal, name);
  }
  RunControl terminal;
  terminal.request_by_signal(SIGINT, 0, StopTier::stop);
  EXPECT_EQ(terminal.cause().by, "person");
  EXPECT_EQ(terminal.cause().face, "the terminal");
  EXPECT_EQ(terminal.reason(), "by the operator");
  setenv("SLURM_JOB_ID", "7", 1);
  RunControl job;
  job.request_by_signal(SIGTERM, 0, StopTier::stop);
  EXPECT_EQ(job.reason(), "by the scheduler (Slurm, job 7)");
  RunControl person;
  person.request_by_signal(SIGINT, 0, StopTier::stop);
  EXPECT_EQ(person.cause().by, "person") << "Ctrl-C in a job is a person's";
  unsetenv("SLURM_JOB_ID");
}

TEST_F(RunControlUnit, ASignalsSenderIsNamedByItsProcess) {
  control.request_by_signal(SIGTERM, getpid(), StopTier::stop);
  std::string own;
  {
    FILE* const file = std::fopen("/proc/self/comm", "r");
    char text[32] = {};
    ASSERT_NE(std::fgets(text, sizeof text, file), nullptr);
    std::fclose(file);
    own = text;
    own.pop_back();  // the end of its line
  }
  EXPECT_EQ(control.cause().name, own);
  EXPECT_EQ(control.reason(), "by SIGTERM of " + own);
  RunControl gone;
  gone.request_by_signal(SIGTERM, 0x3ffffff, StopTier::stop);  // above the largest process number
  EXPECT_EQ(gone.reason(), "by SIGTERM");
}

TEST_F(RunControlUnit, TheDevicesAreMadeSafeOnceAndAtAnAbortBeforeTheCleanUp) {
  control.request(StopTier::stop);
  control.begin_stopping();
  EXPECT_TRUE(control.stop_felt());
  EXPECT_EQ(made_safe, 0) << "the clean-up of a stop comes first";
  EXPECT_FALSE(control.safe());
  control.request(StopTier::abort);
  control.begin_stopping();
  control.begin_stopping();
  control.make_safe();
  EXPECT_EQ(made_safe, 1);
  EXPECT_TRUE(control.safe());
  EXPECT_EQ(control.failures(), (std::vector<std::string>{"lamp: is gone"}));
}

TEST_F(RunControlUnit, TheStatusIsTheTrueOne) {
  EXPECT_EQ(control.status().phase, RunPhase::running);
  control.set_phase(RunPhase::suspended, "no light");
  EXPECT_EQ(control.status().note, "no light");
  control.set_phase(RunPhase::running);
  for (const RunPhase phase :
       {RunPhase::running, RunPhase::pause_requested, RunPhase::paused, RunPhase::suspended}) {
    RunControl one;
    one.set_phase(phase, "a note");
    one.request(StopTier::stop);
    EXPECT_EQ(one.status().phase, RunPhase::stop_requested) << "asked for, and not felt yet";
    EXPECT_EQ(one.status().note, "");
    EXPECT_EQ(one.status().tier, StopTier::stop);
    one.begin_stopping();
    EXPECT_EQ(one.status().phase, RunPhase::stopping);
  }
}

TEST_F(RunControlUnit, APauseIsWantedWhereItWasAskedForUntilItIsResumed) {
  EXPECT_FALSE(control.pause_wanted_at("before A"));
  EXPECT_TRUE(control.resumed());
  control.request_pause();
  EXPECT_TRUE(control.pause_wanted_at("before A"));
  EXPECT_EQ(control.status().phase, RunPhase::pause_requested);
  EXPECT_EQ(control.status().note, "at the next checkpoint");
  EXPECT_FALSE(control.resumed());
  control.resume();
  EXPECT_EQ(control.status().phase, RunPhase::running);
  EXPECT_EQ(control.status().note, "");
  EXPECT_FALSE(control.pause_wanted_at("before A"));
  control.request_pause("before B");
  EXPECT_FALSE(control.pause_wanted_at("before A"));
  EXPECT_TRUE(control.pause_wanted_at("before B"));
  EXPECT_EQ(control.status().note, "at the checkpoint 'before B'");
  control.set_phase(RunPhase::stopping);
  control.request_pause();
  EXPECT_EQ(control.status().phase, RunPhase::stopping) << "no pause of a run that ends";
  control.resume();
  EXPECT_EQ(control.status().phase, RunPhase::stopping);
}

TEST_F(RunControlUnit, FacesAreToldOfEachChangeOnce) {
  auto changes = [this, before = control.changes()]() mutable {
    return control.changes() - std::exchange(before, control.changes());
  };
  changes();
  control.set_phase(RunPhase::running);
  EXPECT_EQ(changes(), 1u);
  control.set_waiting_for("stage:move_to");
  EXPECT_EQ(changes(), 1u);
  EXPECT_EQ(control.status().waiting_for, "stage:move_to");
  control.set_waiting_for("stage:move_to");
  EXPECT_EQ(changes(), 0u) << "the same again";
  control.request_pause();
  EXPECT_EQ(changes(), 1u);
  control.resume();
  EXPECT_EQ(changes(), 1u);
  control.request(StopTier::stop);
  EXPECT_EQ(changes(), 1u);
}

TEST_F(RunControlUnit, TheRestIsTheTimeSoFarTimesWhatIsLeft) {
  control.set_progress(0.005, "frames");
  EXPECT_LT(control.status().remaining, 0) << "the first percent says nothing";
  const auto began = Clock::now();
  while (Clock::now() - began < 20ms) std::this_thread::yield();
  control.set_progress(0.25, "");
  const double remaining = control.status().remaining;
  EXPECT_GE(remaining, 3 * 0.020);
  EXPECT_LT(remaining, 3 * 5.0);
  EXPECT_EQ(control.status().doing, "frames") << "kept where nothing new is said";
  EXPECT_EQ(control.status().progress, 0.25);
  control.set_progress(1, "done");
  EXPECT_NEAR(control.status().remaining, 0, 1e-12);
}

TEST_F(RunControlUnit, BetweenTwoStatementsNoScriptIsStoppedAndANewOneForgets) {
  control.request(StopTier::abort, "because", {"disk"});
  control.begin_stopping();
  control.set_idle(false);
  EXPECT_EQ(control.tier(), StopTier::none);
  EXPECT_FALSE(control.since(StopTier::stop));
  EXPECT_FALSE(control.since(StopTier::abort));
  EXPECT_FALSE(control.safe());
  EXPECT_FALSE(control.stop_felt());
  EXPECT_EQ(control.reason(), "by the operator");
  EXPECT_EQ(control.cause().by, "person");
  EXPECT_EQ(control.status().phase, RunPhase::running);
  control.set_idle(true);
  const int before = interrupted;
  control.request(StopTier::stop);
  control.request_by_signal(SIGTERM, 0, StopTier::stop);
  EXPECT_EQ(control.tier(), StopTier::none);
  EXPECT_EQ(interrupted, before);
  control.make_safe_between();
  EXPECT_EQ(made_safe, 2);
  control.set_idle(false);
  EXPECT_EQ(control.reason(), "by the operator") << "the signal was answered";
  control.make_safe();
  EXPECT_EQ(made_safe, 3) << "a safe state of its own";
  control.request_pause();
  control.set_idle(false);
  EXPECT_EQ(control.status().phase, RunPhase::pause_requested) << "a pause is kept";
}

TEST_F(RunControlUnit, AnotherThreadsRequestIsDeliveredToTheScriptsThread) {
  std::thread other([this] { control.request_and_wait(StopTier::stop); });
  const auto began = Clock::now();
  while (interrupted == 0 && Clock::now() - began < 2s) usleep(100);
  other.join();
  EXPECT_EQ(interrupted, 1);
  EXPECT_LT(Clock::now() - began, 1s) << "and returned when it was";
}

TEST_F(RunControlUnit, ADetachedControlReachesNoScriptAndWaitsForNone) {
  EXPECT_EQ(attached_control(), &control);
  RunControl second;
  second.attach({[] {}, [] { return std::vector<std::string>{}; }});
  control.detach();
  EXPECT_EQ(attached_control(), &second) << "another run's is left alone";
  second.detach();
  EXPECT_EQ(attached_control(), nullptr);
  const auto began = Clock::now();
  std::thread other([this] { control.request_and_wait(StopTier::stop); });
  other.join();
  EXPECT_LT(Clock::now() - began, 1s);
  EXPECT_EQ(interrupted, 0);
  EXPECT_EQ(control.tier(), StopTier::stop);
}

TEST_F(RunControlUnit, AnOverrideIsTakenOnce) {
  EXPECT_EQ(control.take_override(), "");
  control.override_suspension("anna");
  EXPECT_EQ(control.take_override(), "anna");
  EXPECT_EQ(control.take_override(), "");
  control.set_location("p.lua:3");
  EXPECT_EQ(control.location(), "p.lua:3");
}

TEST_F(RunControlUnit, TheWatchdogIsWokenByARequestAndWaitsNoLongerThanItsPatience) {
  auto began = Clock::now();
  control.wait_for_request(15ms);
  EXPECT_GE(Clock::now() - began, 14ms);
  EXPECT_LT(Clock::now() - began, 2s);
  control.request(StopTier::stop);
  began = Clock::now();
  control.wait_for_request(20s);
  EXPECT_LT(Clock::now() - began, 5s);
  control.wake_watchdog();
  began = Clock::now();
  control.wait_for_request(20s);
  EXPECT_LT(Clock::now() - began, 5s);
  began = Clock::now();
  control.wait_for_request(1100ms);  // over the second's end
  EXPECT_GE(Clock::now() - began, 1090ms);
  EXPECT_LT(Clock::now() - began, 4s);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
