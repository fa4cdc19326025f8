// Run control at the prompt: a statement has no cause of the one before, and between two of them
// nothing is asked, named or waited for.
// SPDX-License-Identifier: Apache-2.0
#include "host/session/run_control.h"

#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

TEST(RunControlStatement, ASignalsCauseIsTheProcessThatSentItAlsoTheFirstOne) {
  std::string name;
  std::ifstream("/proc/1/comm") >> name;
  ASSERT_NE(name, "");
  RunControl control;
  control.request_by_signal(SIGTERM, 1, StopTier::stop);
  EXPECT_EQ(control.cause().name, name);
}

TEST(RunControlStatement, IsNotEndedByTheSignalOfTheOneBefore) {
  RunControl control;
  control.request_by_signal(SIGTERM, 0, StopTier::stop);
  EXPECT_NE(control.cause().signal, "");
  control.set_idle(true);
  control.set_idle(false);
  control.request(StopTier::stop);
  EXPECT_EQ(control.cause().by, "person");
  EXPECT_EQ(control.cause().signal, "");
}

TEST(RunControlStatement, BetweenTwoNoSignalChangesWhyTheLastOneEnded) {
  RunControl unasked;
  unasked.set_idle(true);
  unasked.request_by_signal(SIGTERM, 0, StopTier::stop);
  EXPECT_EQ(unasked.cause().signal, "");
  RunControl stopped;
  stopped.request(StopTier::stop, "the script says so", EndCause{"script"});
  stopped.set_idle(true);
  stopped.request_by_signal(SIGINT, 0, StopTier::abort);
  EXPECT_EQ(stopped.cause().by, "script");
  EXPECT_EQ(stopped.reason(), "the script says so");
}

TEST(RunControlStatement, BetweenTwoThereIsNothingToWaitFor) {
  RunControl control;
  control.attach({[] {}, [] { return std::vector<std::string>{}; }});
  control.set_idle(true);
  const auto begun = Clock::now();
  std::thread([&] { control.request_and_wait(StopTier::stop); }).join();
  EXPECT_LT(Clock::now() - begun, 1s) << "it is patient for 2 s";
  control.detach();
}

TEST(RunControlStatement, AFreshControlWasAskedForNothing) {
  RunControl control;
  const auto begun = Clock::now();
  control.wait_for_request(60ms);
  EXPECT_GE(Clock::now() - begun, 60ms);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
