// Run control: requests from any thread, their reasons and their delivery against the header's
// words.
// SPDX-License-Identifier: Apache-2.0
#include "host/session/run_control.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <iterator>
#include <limits>
#include <pthread.h>
#include <random>
#include <string>
#include <thread>
#include <tuple>
#include <unistd.h>
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

TEST(RunControlReference, a_new_control_has_been_asked_for_nothing) {
  const RunControl control;
  EXPECT_EQ(control.tier(), StopTier::none);
  EXPECT_EQ(control.status().phase, RunPhase::running);
  EXPECT_EQ(control.status().tier, StopTier::none);
  EXPECT_LT(control.status().remaining, 0);
  EXPECT_EQ(to_string(control.status()), "running");
  EXPECT_FALSE(control.stop_felt());
  EXPECT_FALSE(control.safe());
  EXPECT_TRUE(control.resumed());
  EXPECT_FALSE(control.pause_wanted_at("anywhere"));
  EXPECT_FALSE(control.pause_wanted_at(""));
  EXPECT_EQ(control.location(), "");
  EXPECT_TRUE(control.failures().empty());
  expect_cause(control, {"person"}, "by the operator");
  for (const StopTier tier : {StopTier::stop, StopTier::abort, StopTier::emergency})
    EXPECT_FALSE(control.since(tier));
  EXPECT_EQ(attached_control(), nullptr);
}

TEST(RunControlReference, the_tier_only_rises_and_each_request_for_it_breaks_off_a_wait) {
  Script script;
  RunControl control;
  control.request(StopTier::stop);  // nothing attached: kept for the script that comes
  EXPECT_EQ(control.tier(), StopTier::stop);
  control.attach(script.hooks());
  EXPECT_EQ(attached_control(), &control);
  EXPECT_EQ(control.tier(), StopTier::stop);
  EXPECT_EQ(to_string(control.status()), "stop requested");
  const int before = script.interrupts;
  control.request(StopTier::stop);
  EXPECT_EQ(script.interrupts, before + 1);
  control.request(StopTier::abort);
  EXPECT_EQ(script.interrupts, before + 2);
  EXPECT_EQ(control.tier(), StopTier::abort);
  EXPECT_EQ(control.status().tier, StopTier::abort);
  EXPECT_EQ(to_string(control.status()), "stop requested (abort)");
  control.request(StopTier::stop);
  EXPECT_EQ(control.tier(), StopTier::abort);
  control.request(StopTier::emergency, "why");
  control.request(StopTier::abort, "why not");
  control.request_by_signal(SIGTERM, 0, StopTier::stop);
  EXPECT_EQ(control.tier(), StopTier::emergency);
  EXPECT_EQ(to_string(control.status()), "stop requested (emergency stop)");
  const int then = script.interrupts;
  deliver_to_script();
  EXPECT_EQ(script.interrupts, then + 1);
  control.detach();
  EXPECT_EQ(attached_control(), nullptr);
  control.request(StopTier::emergency);
  EXPECT_EQ(script.interrupts, then + 1);
  EXPECT_FALSE(control.stop_felt());  // none of it was felt yet
  EXPECT_EQ(script.safe_states, 0);
}

// "A lower tier than before changes nothing", and so does a request for none.
TEST(RunControlReference, a_lower_tier_does_not_reach_the_script) {
  Script script;
  RunControl control;
  control.attach(script.hooks());
  control.request(StopTier::none);
  EXPECT_EQ(script.interrupts, 0);
  control.request(StopTier::abort);
  const int before = script.interrupts;
  const unsigned long changes = control.changes();
  control.request(StopTier::stop);
  EXPECT_EQ(script.interrupts, before);
  EXPECT_EQ(control.changes(), changes);
  control.detach();
}

TEST(RunControlReference, one_more_ctrl_c_means_the_next_tier_as_far_as_abort) {
  EXPECT_EQ(RunControl::next(StopTier::none), StopTier::stop);
  EXPECT_EQ(RunControl::next(StopTier::stop), StopTier::abort);
  EXPECT_EQ(RunControl::next(StopTier::abort), StopTier::abort);
}

TEST(RunControlReference, the_next_tier_is_never_a_lower_one) {
  EXPECT_GE(RunControl::next(StopTier::emergency), StopTier::emergency);
}

TEST(RunControlReference, since_is_counted_from_the_first_request_of_at_least_that_tier) {
  RunControl control;
  control.request(StopTier::stop);
  EXPECT_TRUE(control.since(StopTier::stop));
  EXPECT_FALSE(control.since(StopTier::abort));
  std::this_thread::sleep_for(25ms);
  control.request(StopTier::abort);
  EXPECT_FALSE(control.since(StopTier::emergency));
  std::this_thread::sleep_for(15ms);
  control.request(StopTier::stop);
  control.request(StopTier::abort);  // not the first
  const auto abort = *control.since(StopTier::abort);
  const auto stop = *control.since(StopTier::stop);
  EXPECT_GE(abort, 15ms);
  EXPECT_GE(stop - abort, 24ms);
  EXPECT_LT(stop, 10s);
  RunControl other;
  other.request(StopTier::emergency);
  for (const StopTier tier : {StopTier::stop, StopTier::abort, StopTier::emergency})
    EXPECT_TRUE(other.since(tier)) << to_string(tier);
}

TEST(RunControlReference, reason_and_cause_are_of_the_request_that_asked_for_more) {
  RunControl control;
  control.request(StopTier::stop, "the gel is dry", {"person", "Ann", "the live view"});
  control.request(StopTier::stop, "again", {"person", "Ben", "the terminal"});
  expect_cause(control, {"person", "Ann", "the live view"}, "the gel is dry");
  control.request(StopTier::abort, "the lamp burns", {"device", "lamp"});
  control.request(StopTier::stop, "late", {"scheduler", "slurm"});
  expect_cause(control, {"device", "lamp"}, "the lamp burns");
  control.request(StopTier::emergency, "told so");
  expect_cause(control, {"program"}, "told so");
  control.set_reason("in other words");
  EXPECT_EQ(control.reason(), "in other words");
  control.set_location("protocols/drift.lua:12");
  EXPECT_EQ(control.location(), "protocols/drift.lua:12");
}

TEST(RunControlReference, a_signal_is_told_by_its_name_and_its_senders) {
  char before[16] = {};
  pthread_getname_np(pthread_self(), before, sizeof before);
  pthread_setname_np(pthread_self(), "fifteen letters");
  RunControl control;
  control.request_by_signal(SIGTERM, getpid(), StopTier::stop);
  pthread_setname_np(pthread_self(), "other");
  control.request_by_signal(SIGHUP, getpid(), StopTier::abort);  // the first one counts
  EXPECT_EQ(control.tier(), StopTier::abort);
  expect_cause(control, {"signal", "fifteen letters", "", "SIGTERM"},
               "by SIGTERM of fifteen letters");
  control.request(StopTier::abort, "no more than before", {"device", "lamp"});
  EXPECT_EQ(control.cause().by, "signal");
  control.request(StopTier::emergency, "more", {"device", "lamp"});
  expect_cause(control, {"device", "lamp"}, "more");
  pthread_setname_np(pthread_self(), before);

  RunControl terminal;
  terminal.request_by_signal(SIGINT, 0, StopTier::stop);
  expect_cause(terminal, {"person", "", "the terminal", "SIGINT"}, "by the operator");
  RunControl gone;  // no such process
  gone.request_by_signal(SIGQUIT, std::numeric_limits<pid_t>::max(), StopTier::abort);
  expect_cause(gone, {"signal", "", "", "SIGQUIT"}, "by SIGQUIT");
}

// docs/safety.md: "The reason in the end record is that of the strongest command".
TEST(RunControlReference, a_stronger_signal_gives_the_cause) {
  RunControl control;
  control.request(StopTier::stop, "the protocol's", {"protocol", "drift"});
  control.request_by_signal(SIGTERM, getpid(), StopTier::abort);
  EXPECT_EQ(control.cause().signal, "SIGTERM");
  EXPECT_NE(control.reason(), "the protocol's");
}

// What asks for no more than was asked for changes neither reason nor cause.
TEST(RunControlReference, a_signal_that_asks_for_no_more_leaves_the_cause) {
  RunControl control;
  control.request(StopTier::abort, "the protocol's", {"protocol", "drift"});
  control.request_by_signal(SIGQUIT, 0, StopTier::abort);
  EXPECT_EQ(control.cause().by, "protocol");
  EXPECT_EQ(control.reason(), "the protocol's");
}

TEST(RunControlReference, slurms_step_daemon_is_the_scheduler_also_without_a_number) {
  const char* const job = std::getenv("SLURM_JOB_ID");
  if (job != nullptr) GTEST_SKIP() << "within a job";
  char before[16] = {};
  pthread_getname_np(pthread_self(), before, sizeof before);
  pthread_setname_np(pthread_self(), "slurmstepd");
  RunControl control;
  control.request_by_signal(SIGCONT, getpid(), StopTier::stop);
  pthread_setname_np(pthread_self(), before);
  EXPECT_EQ(control.cause().by, "scheduler");
  EXPECT_EQ(control.cause().name, "Slurm");
}

TEST(RunControlReference, a_signal_between_two_statements_is_no_cause) {
  RunControl control;
  control.set_idle(true);
  control.request_by_signal(SIGTERM, getpid(), StopTier::stop);
  EXPECT_EQ(control.tier(), StopTier::none);
  const auto start = std::chrono::steady_clock::now();
  control.request_and_wait(StopTier::stop);  // no script runs that could be waited for
  EXPECT_LT(std::chrono::steady_clock::now() - start, 1500ms);
  control.make_safe_between();
  control.set_idle(false);
  control.request_by_signal(SIGINT, 0, StopTier::stop);
  EXPECT_EQ(control.cause().signal, "SIGINT");
}

TEST(RunControlReference, signals_leave_no_file_open) {
  const auto open_files = [] {
    const std::filesystem::directory_iterator files("/proc/self/fd");
    return std::distance(begin(files), end(files));
  };
  const auto before = open_files();
  for (int i = 0; i < 20; ++i) RunControl().request_by_signal(SIGTERM, getpid(), StopTier::stop);
  EXPECT_EQ(open_files(), before);
}

TEST(RunControlReference, a_rig_without_a_safe_state_can_be_aborted) {
  RunControl control;
  control.attach({[] {}, nullptr});
  control.request(StopTier::abort);
  control.begin_stopping();
  EXPECT_TRUE(control.stop_felt());
  EXPECT_TRUE(control.failures().empty());
  control.detach();
}

TEST(RunControlReference, requests_of_several_threads_reach_the_scripts_thread_alone) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    Script script;
    RunControl control;
    control.attach(script.hooks());
    std::atomic<int> highest{0};
    std::vector<std::thread> threads;
    for (std::uint64_t k = 0; k < 4; ++k)
      threads.emplace_back([&, k] {
        std::mt19937_64 random(10 * seed + k);
        int mine = 0;
        for (int n = 0; n < 30; ++n) {
          const int tier = 1 + static_cast<int>(random() % (seed == 1 ? 1 : 3));
          mine = std::max(mine, tier);
          control.request(static_cast<StopTier>(tier), "thread " + std::to_string(k));
          EXPECT_GE(static_cast<int>(control.tier()), mine);
          EXPECT_TRUE(control.since(static_cast<StopTier>(tier)));
          control.request_pause("p");
          control.resume();
        }
        for (int seen = highest; seen < mine && !highest.compare_exchange_weak(seen, mine);) {
        }
      });
    for (std::thread& thread : threads) thread.join();
    EXPECT_EQ(static_cast<int>(control.tier()), highest);
    EXPECT_EQ(control.status().phase, RunPhase::stop_requested);
    EXPECT_EQ(control.reason().substr(0, 7), "thread ");
    EXPECT_GE(script.interrupts, 1);
    EXPECT_EQ(script.elsewhere, 0);
    control.detach();
  }
}

TEST(RunControlReference, a_task_that_waits_for_its_request_finds_the_script_reached) {
  Script script;
  RunControl control;
  control.attach(script.hooks());
  std::thread([&] {
    for (int n = 0; n < 20; ++n) {
      const int before = script.interrupts;
      control.request_and_wait(n < 10 ? StopTier::stop : StopTier::abort);
      EXPECT_GE(script.interrupts, before + 1);
    }
  }).join();
  EXPECT_EQ(script.elsewhere, 0);
  EXPECT_EQ(control.tier(), StopTier::abort);
  const int before = script.interrupts;
  control.request_and_wait(StopTier::abort);  // on the script's own thread
  EXPECT_GE(script.interrupts, before + 1);
  control.detach();
}

TEST(RunControlReference, the_watchdog_waits_for_a_request_and_no_longer_than_it_has_patience) {
  using Clock = std::chrono::steady_clock;
  RunControl control;
  auto begin = Clock::now();
  control.wait_for_request(30ms);
  EXPECT_GE(Clock::now() - begin, 29ms);
  for (const bool woken : {false, true}) {
    begin = Clock::now();
    std::thread other([&] {
      std::this_thread::sleep_for(10ms);
      if (woken)
        control.wake_watchdog();
      else
        control.request(StopTier::stop);
    });
    control.wait_for_request(60s);
    EXPECT_LT(Clock::now() - begin, 30s);
    other.join();
  }
  EXPECT_EQ(control.tier(), StopTier::stop);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
