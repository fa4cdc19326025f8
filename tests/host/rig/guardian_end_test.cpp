// The real guardian and the end of its host: one that took it for a death would kill this process.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/kepco_bop/emulator.h"
#include "host/safety/guardian.h"
#include "tests/devices/links/real_end.h"

#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <random>
#include <sys/wait.h>
#include <thread>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

struct GuardianEnd : ::testing::Test {
  std::unique_ptr<kepco_bop::Emulator> emulator = kepco_bop::make_emulator({});
  RealEnd supply{*emulator, open_pty_end()};
  const std::vector<guardian::Output> outputs{{"kepco_bop", supply.address()}};
  std::mt19937 random{7};
  /// Up to a beat.
  void wait_a_little() { std::this_thread::sleep_for(std::chrono::microseconds(random() % 25000)); }
};

// An acknowledgement that the host has not read when it closes the socket is told of first, in the
// place of what it has said before.
TEST_F(GuardianEnd, SoonAfterTheZeroItIsNoDeath) {
  for (int i = 0; i < 60; ++i) {
    Guardian guardian(outputs, [] { return true; });
    guardian.arm("coils");
    if (i % 2 == 0) wait_a_little();
    guardian.disarm("coils");
    if (i % 3 == 0) wait_a_little();
  }
}

TEST_F(GuardianEnd, WithoutAZeroItIsWorkForTheGuardianAndNoDeath) {
  for (int i = 0; i < 20; ++i) {
    pid_t process = 0;
    {
      Guardian guardian(outputs, [] { return true; });
      process = guardian.process();
      guardian.arm("coils");
      if (i % 2 == 0) wait_a_little();
    }
    int status = 0;
    ASSERT_EQ(waitpid(process, &status, 0), process);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << "not at zero";
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
