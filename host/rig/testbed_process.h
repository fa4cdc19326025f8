// Processes of an emulated laboratory: this program within the testbed, the command that runs among
// the instruments, and the signals that end them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

namespace vitreo {

/// Runs a command among the emulated instruments that stand in place; its exit code. Ctrl-C goes to
/// the command. Throws ConfigError when it cannot be run.
int run_among(const std::vector<std::string>& command);

/// Serves until SIGINT, SIGTERM or SIGHUP; blocks them from its construction on, so that threads
/// made later do not take them.
class EndingSignals {
 public:
  EndingSignals();
  ~EndingSignals();
  EndingSignals(const EndingSignals&) = delete;
  EndingSignals& operator=(const EndingSignals&) = delete;
  void wait() const;

 private:
  struct Sets;
  std::unique_ptr<Sets> sets_;
};

/// Starts this program again, with the same words, under umockdev-wrapper; returns only when that
/// is not needed, or not to be had.
void restart_in_testbed(char** words);

}  // namespace vitreo
