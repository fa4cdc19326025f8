// A stop between two statements of the prompt: asked by whom, answered once, and never lost.
// SPDX-License-Identifier: Apache-2.0
#include "host/session/run_control.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

/// A prompt that stands idle behind its first statement.
struct StopBetweenTwo : testing::Test {
  void SetUp() override {
    unsetenv("SLURM_JOB_ID");
    control.attach({[this] { ++interrupted; },
                    [this] {
                      ++made_safe;
                      return failures;
                    }});
    control.set_idle(true);
  }
  void TearDown() override { control.detach(); }
  RunControl control;
  std::vector<std::string> failures;
  std::atomic<int> interrupted{0}, made_safe{0};
};

TEST_F(StopBetweenTwo, IsAnsweredOnceWithTheSafeStateAndSaysWhyAndByWhom) {
  EXPECT_FALSE(control.between().since());
  control.make_safe_between();
  EXPECT_EQ(made_safe, 0) << "nothing was asked";
  EXPECT_FALSE(control.take_answered());
  failures = {"coils: are gone"};
  control.request(StopTier::stop, "by Ann", {"person", "Ann", "the live view"});
  ASSERT_TRUE(control.between().since());
  EXPECT_LT(*control.between().since(), 10s);
  EXPECT_EQ(interrupted, 0) << "no script runs";
  EXPECT_FALSE(control.take_answered()) << "not yet";
  control.make_safe_between();
  control.make_safe_between();
  EXPECT_EQ(made_safe, 1);
  EXPECT_FALSE(control.between().since());
  const auto answered = control.take_answered();
  ASSERT_TRUE(answered);
  EXPECT_EQ(answered->reason, "by Ann");
  EXPECT_EQ(answered->cause.name, "Ann");
  EXPECT_EQ(answered->cause.face, "the live view");
  EXPECT_EQ(answered->failures, failures);
  EXPECT_EQ(control.failures(), failures) << "for the record's end";
  EXPECT_FALSE(control.take_answered()) << "told once";
  const auto begun = std::chrono::steady_clock::now();
  control.request(StopTier::stop, "by Ben", {"person", "Ben"});
  const auto since = control.between().since();
  EXPECT_LE(*since, std::chrono::steady_clock::now() - begun) << "its time is its own";
  control.make_safe_between();
  EXPECT_EQ(made_safe, 2) << "each request has its own";
  EXPECT_EQ(control.take_answered()->reason, "by Ben");
}

TEST_F(StopBetweenTwo, OfSeveralTheFirstSaysWhyAndTheStrongestIsShown) {
  control.request(StopTier::stop, "by Ann", {"person", "Ann"});
  control.request(StopTier::emergency, "by Ben", {"person", "Ben"});
  control.request(StopTier::abort);
  EXPECT_EQ(control.between().tier(), StopTier::emergency);
  EXPECT_EQ(to_string(control.status()), "stop requested (emergency stop)");
  control.make_safe_between();
  EXPECT_EQ(made_safe, 1);
  EXPECT_EQ(control.take_answered()->reason, "by Ann");
  EXPECT_EQ(to_string(control.status()), "ready");
}

TEST_F(StopBetweenTwo, IsSeenByTheFacesThatPoll) {
  unsigned long before = control.changes();
  const auto changes = [&] {
    const unsigned long now = control.changes();
    return std::exchange(before, now) != now;
  };
  control.request(StopTier::stop);
  EXPECT_TRUE(changes());
  control.request(StopTier::stop, "by Ann", {"person", "Ann"});
  EXPECT_TRUE(changes());
  control.request_by_signal(SIGTERM, 0, StopTier::stop);
  EXPECT_TRUE(changes());
  control.make_safe_between();
  EXPECT_TRUE(changes());
  control.set_idle(false);
  EXPECT_TRUE(changes());
  control.set_idle(true);
  EXPECT_TRUE(changes());
  EXPECT_FALSE(changes());
}

TEST_F(StopBetweenTwo, OfASignalSaysWhichOne) {
  control.request_by_signal(SIGTERM, 0, StopTier::stop);
  control.request_by_signal(SIGINT, 0, StopTier::stop);
  control.make_safe_between();
  const auto answered = control.take_answered();
  ASSERT_TRUE(answered);
  EXPECT_EQ(answered->cause.signal, "SIGTERM");
  EXPECT_EQ(answered->reason, "by SIGTERM");
  control.request(StopTier::stop);
  control.make_safe_between();
  EXPECT_EQ(control.take_answered()->reason, "by the operator") << "the signal's time is over";
}

TEST_F(StopBetweenTwo, WithoutAnAnswerEndsTheNextStatementBeforeItBegins) {
  control.request(StopTier::abort, "by Ann", {"person", "Ann"});
  control.set_idle(false);
  EXPECT_EQ(control.tier(), StopTier::abort);
  EXPECT_EQ(interrupted, 1);
  EXPECT_EQ(control.reason(), "by Ann");
  EXPECT_EQ(control.cause().name, "Ann");
  EXPECT_TRUE(control.since(StopTier::abort));
  control.make_safe_between();
  EXPECT_EQ(made_safe, 0) << "it is the statement's now";
  control.set_idle(true);
  control.request_by_signal(SIGTERM, 0, StopTier::stop);
  control.set_idle(false);
  EXPECT_EQ(control.tier(), StopTier::stop);
  EXPECT_EQ(control.cause().signal, "SIGTERM");
  control.set_idle(true);
  control.set_idle(false);
  EXPECT_EQ(control.tier(), StopTier::none) << "once";
}

TEST_F(StopBetweenTwo, FindsNothingLeftOfTheStatementBefore) {
  control.set_idle(false);
  control.set_progress(0.02, "bringing the robot in");
  control.set_waiting_for("servo:go_to");
  control.request(StopTier::abort, "by Ann", {"person", "Ann"});
  control.begin_stopping();
  ASSERT_TRUE(control.since(StopTier::abort));
  control.set_idle(true);
  EXPECT_FALSE(control.since(StopTier::stop)) << "its deadlines are over";
  EXPECT_FALSE(control.since(StopTier::abort));
  EXPECT_EQ(control.tier(), StopTier::none) << "else the next signal would end the process";
  const RunStatus status = control.status();
  EXPECT_EQ(to_string(status), "ready");
  EXPECT_EQ(status.progress, 0);
  EXPECT_EQ(status.doing, "");
  EXPECT_LT(status.remaining, 0);
}

TEST_F(StopBetweenTwo, OrInOneIsNotSafeBeforeTheThreadThatCameFirstIsThrough) {
  std::atomic<bool> begun{false}, goes_on{false};
  RunControl slow;
  slow.attach({[] {},
               [&] {
                 begun = true;
                 while (!goes_on) std::this_thread::yield();
                 return std::vector<std::string>();
               }});
  EXPECT_FALSE(slow.making_safe());
  std::thread watchdog([&] { slow.make_safe(); });
  while (!begun) std::this_thread::yield();
  slow.make_safe();  // has come second
  EXPECT_TRUE(slow.making_safe());
  goes_on = true;
  watchdog.join();
  EXPECT_FALSE(slow.making_safe());
  slow.detach();
}

TEST_F(StopBetweenTwo, IsNotLostWhileThePromptTurnsToAStatementAndBack) {
  constexpr int kRequests = 500;
  std::atomic<int> asked{0}, served{0};
  std::atomic<bool> ended{false};
  std::thread asker([&] {
    while (!ended && asked < kRequests) {
      ++asked;
      control.request(StopTier::stop, "by Ann", {"person", "Ann"});
      while (!ended && served < asked) std::this_thread::yield();
    }
  });
  const auto until = std::chrono::steady_clock::now() + 30s;
  int felt_before = 0;
  while (served < kRequests && std::chrono::steady_clock::now() < until) {
    const int now_asked = asked;
    control.set_idle(false);
    control.set_idle(true);
    control.make_safe_between();
    const bool answered = control.take_answered().has_value();
    // Felt by the statement: its script was interrupted.
    const int felt = interrupted;
    if (answered || felt != felt_before) served = std::max<int>(now_asked, asked);
    felt_before = felt;
  }
  EXPECT_EQ(served, kRequests) << "the one after these was lost";
  ended = true;
  asker.join();
  control.make_safe_between();
  EXPECT_EQ(control.tier(), StopTier::none) << "none is left behind for the next signal to raise";
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
