// Program of the cases that run in the guest of `make test-kernel`; run.py reads what it reports.
// SPDX-License-Identifier: Apache-2.0
#include "tests/kernel/guest.h"

#include <gtest/gtest.h>

#include <csignal>
#include <sstream>

namespace vitreo::kernel_guest {
namespace {

/// Each case as it begins, fails and ends: a machine that stops in between has said so much.
class Reporter : public ::testing::EmptyTestEventListener {
  void OnTestStart(const ::testing::TestInfo& info) override {
    send_line("CASE", std::string(info.test_suite_name()) + "." + info.name());
  }
  void OnTestPartResult(const ::testing::TestPartResult& result) override {
    if (!result.failed()) return;
    std::istringstream lines(result.message());
    const char* const file = result.file_name() != nullptr ? result.file_name() : "?";
    send_line("SAID", std::string(file) + ":" + std::to_string(result.line_number()));
    for (std::string line; std::getline(lines, line);) send_line("SAID", line);
  }
  void OnTestEnd(const ::testing::TestInfo& info) override {
    const bool passed = info.result()->Passed() && !info.result()->Skipped();
    send_line(passed ? "PASSED" : "FAILED",
              std::to_string(static_cast<double>(info.result()->elapsed_time()) * 1e-3));
  }
};

}  // namespace
}  // namespace vitreo::kernel_guest

int main(int count, char** words) {
  ::testing::InitGoogleTest(&count, words);
  ::signal(SIGPIPE, SIG_IGN);
  ::testing::UnitTest::GetInstance()->listeners().Append(new vitreo::kernel_guest::Reporter);
  return RUN_ALL_TESTS();
}
