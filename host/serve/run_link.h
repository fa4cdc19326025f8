// Link to the run of a job's process: found by the process behind its control socket, followed and
// steered through it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/view/control_client.h"

#include <chrono>
#include <memory>
#include <mutex>
#include <string>

namespace vitreo::serve {

/// Any thread.
class RunLink {
 public:
  /// Looks for the run of this process, and for news of it; does not wait. 0: of none.
  void follow(int process);
  /// Its name; empty while it has no control socket (before the rig is open).
  std::string run() const;
  /// As the desk has it; null before there is one.
  nlohmann::json status() const;
  /// Counts what has come.
  unsigned long changes() const;
  /// One word to the run: {"do": ...}; the control socket's reply. What ends a run reaches its
  /// process also before there is a socket. Throws ConfigError where there is no run.
  nlohmann::json command(const nlohmann::json& request) const;

 private:
  void find(int process);
  bool receive();

  mutable std::mutex mutex_;
  int process_ = 0;
  std::unique_ptr<ControlConnection> connection_;
  nlohmann::json status_;
  unsigned long changes_ = 0;
  std::chrono::steady_clock::time_point looked_{};
};

}  // namespace vitreo::serve
