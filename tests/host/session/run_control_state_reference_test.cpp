// Run control: pauses, the displayed state, progress and safe states against the header's words.
// SPDX-License-Identifier: Apache-2.0
#include "host/session/run_control.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <pthread.h>
#include <string>
#include <thread>
#include <tuple>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Texts = std::vector<std::string>;

/// A script and its rig: counts what reaches it. The handler may come at any moment.
struct Script {
  std::atomic<int> interrupts{0};
  std::atomic<int> elsewhere{0};
  int safe_states = 0;
  Texts failed;
  pthread_t thread = pthread_self();
  RunControl::ScriptHooks hooks() {
    return {[this] {
              ++interrupts;
              if (!pthread_equal(pthread_self(), thread)) ++elsewhere;
            },
            [this] {
              ++safe_states;
              return failed;
            }};
  }
};

void expect_cause(const RunControl& control, const EndCause& wanted, const std::string& reason) {
  const EndCause cause = control.cause();
  EXPECT_EQ(std::tie(cause.by, cause.name, cause.face, cause.signal),
            std::tie(wanted.by, wanted.name, wanted.face, wanted.signal));
  EXPECT_EQ(control.reason(), reason);
}

TEST(RunControlStateReference, a_pause_is_wanted_at_the_next_checkpoint_or_at_the_one_named) {
  RunControl control;
  control.request_pause("before the path");
  EXPECT_FALSE(control.resumed());
  EXPECT_TRUE(control.pause_wanted_at("before the path"));
  EXPECT_FALSE(control.pause_wanted_at("before the hold"));
  EXPECT_FALSE(control.pause_wanted_at(""));
  EXPECT_EQ(to_string(control.status()), "pause requested: at the checkpoint 'before the path'");
  control.request_pause("before the hold");
  EXPECT_TRUE(control.pause_wanted_at("before the hold"));
  EXPECT_FALSE(control.pause_wanted_at("before the path"));
  control.request_pause();
  EXPECT_TRUE(control.pause_wanted_at("before the path"));
  EXPECT_TRUE(control.pause_wanted_at(""));
  EXPECT_EQ(to_string(control.status()), "pause requested: at the next checkpoint");
  control.set_phase(RunPhase::paused, "at before the path");
  EXPECT_EQ(to_string(control.status()), "paused: at before the path");
  EXPECT_FALSE(control.resumed());
  EXPECT_TRUE(control.pause_wanted_at("x"));  // until somebody resumes it
  control.resume();
  EXPECT_TRUE(control.resumed());
  EXPECT_FALSE(control.pause_wanted_at("before the path"));
  EXPECT_EQ(control.status().phase, RunPhase::paused);  // as long as the script has not gone on
  control.set_phase(RunPhase::running);
  EXPECT_EQ(to_string(control.status()), "running");

  control.request_pause();
  control.resume();  // before it took effect
  EXPECT_EQ(to_string(control.status()), "running");
  EXPECT_FALSE(control.pause_wanted_at(""));
}

TEST(RunControlStateReference, an_override_is_taken_once_and_says_by_whom) {
  RunControl control;
  EXPECT_EQ(control.take_override(), "");
  control.override_suspension("Ann");
  control.resume();
  EXPECT_EQ(control.take_override(), "Ann");
  EXPECT_EQ(control.take_override(), "");
}

TEST(RunControlStateReference, the_displayed_state_is_the_true_one) {
  const std::vector<std::tuple<RunPhase, std::string>> names{
      {RunPhase::running, "running"},
      {RunPhase::pause_requested, "pause requested"},
      {RunPhase::paused, "paused"},
      {RunPhase::suspended, "suspended"},
      {RunPhase::stop_requested, "stop requested"},
      {RunPhase::stopping, "stopping"},
      {RunPhase::not_responding, "not responding"},
      {RunPhase::ended, "ended"}};
  for (const auto& [phase, name] : names) {
    RunControl control;
    const unsigned long before = control.changes();
    control.set_phase(phase, "why");
    EXPECT_EQ(to_string(control.status()), name + ": why");
    EXPECT_NE(control.changes(), before);
    const unsigned long then = control.changes();
    control.set_waiting_for("servo:go_to");
    const std::string waits = phase == RunPhase::ended ? "" : ", waiting for servo:go_to";
    EXPECT_EQ(to_string(control.status()), name + ": why" + waits);
    EXPECT_NE(control.changes(), then);
  }
  Script script;
  RunControl control;
  control.attach(script.hooks());
  control.request(StopTier::stop);
  for (const RunPhase hidden : {RunPhase::running, RunPhase::paused, RunPhase::suspended}) {
    control.set_phase(hidden);  // until it is felt the script's own word does not hide it
    EXPECT_EQ(control.status().phase, RunPhase::stop_requested) << to_string(hidden);
  }
  control.begin_stopping();
  control.set_waiting_for("servo:go_to");
  EXPECT_EQ(to_string(control.status()), "stopping, waiting for servo:go_to");
  control.set_waiting_for("");
  control.request(StopTier::abort);
  EXPECT_EQ(to_string(control.status()), "stopping (abort)");  // and not requested again
  control.set_phase(RunPhase::ended);
  control.request(StopTier::emergency);
  EXPECT_EQ(control.status().phase, RunPhase::ended);
  control.detach();
}

TEST(RunControlStateReference, progress_tells_what_remains_at_the_pace_so_far) {
  using Clock = std::chrono::steady_clock;
  const auto seconds = [](Clock::duration d) { return std::chrono::duration<double>(d).count(); };
  RunControl control;
  const auto earliest = Clock::now();
  control.set_progress(0, "focus");
  const auto latest = Clock::now();
  EXPECT_LT(control.status().remaining, 0);
  EXPECT_EQ(control.status().doing, "focus");
  std::this_thread::sleep_for(20ms);
  for (const double fraction : {0.2, 0.625}) {
    const double least = seconds(Clock::now() - latest);
    control.set_progress(fraction, "place 3");
    const double most = seconds(Clock::now() - earliest);
    const RunStatus status = control.status();
    EXPECT_EQ(status.progress, fraction);
    EXPECT_EQ(status.doing, "place 3");
    EXPECT_GE(status.remaining, least * (1 - fraction) / fraction);
    EXPECT_LE(status.remaining, most * (1 - fraction) / fraction);
  }
  control.set_progress(1, "");
  EXPECT_EQ(control.status().remaining, 0);
}

// "Changes each time the status does, for observers that poll".
TEST(RunControlStateReference, progress_is_a_change_of_the_status) {
  RunControl control;
  const unsigned long before = control.changes();
  control.set_progress(0.3, "place 1");
  EXPECT_NE(control.changes(), before);
}

TEST(RunControlStateReference, a_stop_is_felt_and_from_abort_on_the_devices_are_safe_first) {
  for (const StopTier tier : {StopTier::stop, StopTier::abort, StopTier::emergency}) {
    Script script;
    script.failed = {"coils: no answer", "lens_mover: lost"};
    RunControl control;
    control.attach(script.hooks());
    control.request(tier);
    EXPECT_FALSE(control.stop_felt());
    EXPECT_EQ(script.safe_states, 0);
    control.begin_stopping();
    EXPECT_TRUE(control.stop_felt());
    EXPECT_EQ(control.status().phase, RunPhase::stopping);
    const int first = tier == StopTier::stop ? 0 : 1;
    EXPECT_EQ(script.safe_states, first) << to_string(tier);
    EXPECT_EQ(control.safe(), first == 1);
    EXPECT_EQ(control.failures(), first == 1 ? script.failed : Texts{});
    if (tier == StopTier::stop) {  // more is asked for while it unwinds
      control.request(StopTier::abort);
      control.begin_stopping();
    }
    control.make_safe();
    control.make_safe();
    EXPECT_EQ(script.safe_states, 1);
    EXPECT_TRUE(control.safe());
    EXPECT_EQ(control.failures(), script.failed);
    control.detach();
  }
}

// "once after each attach()"
TEST(RunControlStateReference, the_safe_state_is_made_once_after_each_attach) {
  Script script;
  RunControl control;
  for (int n = 1; n <= 2; ++n) {
    control.attach(script.hooks());
    control.make_safe();
    EXPECT_EQ(script.safe_states, n);
    control.detach();
  }
}

TEST(RunControlStateReference,
     between_two_statements_nothing_is_stopped_and_then_all_is_forgotten) {
  Script script;
  RunControl control;
  control.attach(script.hooks());
  control.request(StopTier::abort, "this one", {"device", "lamp"});
  control.begin_stopping();
  const int before = script.interrupts;
  control.set_idle(true);
  control.request(StopTier::emergency);
  control.request_by_signal(SIGINT, 0, StopTier::emergency);
  EXPECT_EQ(script.interrupts, before);
  EXPECT_EQ(control.tier(), StopTier::none) << "the statement has ended, and so has its stop";
  control.make_safe_between();
  const int safe_states = script.safe_states;
  control.set_idle(false);
  EXPECT_EQ(control.tier(), StopTier::none);
  EXPECT_EQ(to_string(control.status()), "running");
  EXPECT_FALSE(control.stop_felt());
  EXPECT_FALSE(control.safe());
  for (const StopTier tier : {StopTier::stop, StopTier::abort, StopTier::emergency})
    EXPECT_FALSE(control.since(tier)) << to_string(tier);
  expect_cause(control, {"person"}, "by the operator");
  control.request(StopTier::stop, "that one");
  EXPECT_EQ(script.interrupts, before + 1);
  EXPECT_EQ(control.reason(), "that one");
  control.begin_stopping();
  control.make_safe();
  EXPECT_EQ(script.safe_states, safe_states + 1);
  control.detach();
}

TEST(RunControlStateReference, a_pause_asked_for_between_two_statements_is_of_the_next) {
  RunControl control;
  control.set_idle(true);
  control.request_pause("there");
  control.set_idle(false);
  EXPECT_FALSE(control.resumed());
  EXPECT_EQ(control.status().phase, RunPhase::pause_requested);
  EXPECT_EQ(control.status().note, "at the checkpoint 'there'");
  control.resume();
  control.set_idle(true);
  control.set_idle(false);
  EXPECT_EQ(control.status().phase, RunPhase::running);
  EXPECT_EQ(control.status().note, "");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
