// SPDX-License-Identifier: Apache-2.0
#include "host/serve/run_link.h"

#include "host/config/config.h"
#include "host/session/operator_desk.h"

#include <csignal>
#include <poll.h>
#include <sys/socket.h>

namespace vitreo::serve {
namespace {

constexpr auto kLookPeriod = std::chrono::milliseconds(300);  // for the socket of a new run

/// The process at the other end of a Unix socket.
// SO_PEERCRED is of the kernel: a run cannot claim to be another one's.
int process_behind(int descriptor) {
  ucred credentials{};
  socklen_t size = sizeof credentials;
  if (getsockopt(descriptor, SOL_SOCKET, SO_PEERCRED, &credentials, &size) != 0) return 0;
  return credentials.pid;
}

}  // namespace

// Called ten times a second by the dispatcher, whose other work must not wait for a run.
void RunLink::follow(int process) {
  const std::lock_guard lock(mutex_);
  if (process != process_) {
    process_ = process;
    connection_.reset();
    status_ = nullptr;
    ++changes_;
  }
  if (process_ == 0) return;
  try {
    if (!connection_) find(process);
    if (connection_ && !receive()) {
      // Its socket goes before its report is written: the last status stays.
      connection_.reset();
    }
  } catch (const std::exception&) {
    // Not an error: between the list of sockets and the connection a run may end.
    // It has just ended.
    connection_.reset();
  }
}

// Every look connects to each run of this user on the machine, so it is made seldom.
void RunLink::find(int process) {
  const auto now = std::chrono::steady_clock::now();
  if (now - looked_ < kLookPeriod) return;
  looked_ = now;
  for (const std::string& name : controllable_runs()) {
    auto connection = std::make_unique<ControlConnection>(name);
    if (process_behind(connection->descriptor()) != process) continue;
    connection->send({{"do", "watch"}});
    connection_ = std::move(connection);
    ++changes_;
    return;
  }
}

/// False when the run is gone.
bool RunLink::receive() {
  pollfd ready{connection_->descriptor(), POLLIN, 0};
  // What has come is taken whole; nothing is waited for.
  while (poll(&ready, 1, 0) > 0)
    if (!connection_->receive()) return false;
  while (const auto message = connection_->next()) {
    if (!message->contains("status")) continue;
    status_ = message->at("status");
    ++changes_;
  }
  return true;
}

std::string RunLink::run() const {
  const std::lock_guard lock(mutex_);
  return connection_ ? connection_->name() : "";
}

nlohmann::json RunLink::status() const {
  const std::lock_guard lock(mutex_);
  return status_;
}

unsigned long RunLink::changes() const {
  const std::lock_guard lock(mutex_);
  return changes_;
}

// By a connection of its own: the one that watches gets the changes of the status in between. The
// lock is not held while the run answers, so that nothing waits for a run that does not.
nlohmann::json RunLink::command(const nlohmann::json& request) const {
  std::string run;
  int process = 0;
  {
    const std::lock_guard lock(mutex_);
    process = process_;
    if (connection_) run = connection_->name();
  }
  if (process == 0) throw ConfigError("no run is going on");
  if (!run.empty()) return control_run(run, request);
  // Before the rig is open there is no socket, but the process takes SIGTERM for a stop.
  const auto word = request.find("do");
  const bool ends = word != request.end() && word->is_string() &&
                    OperatorDesk::ends_run(word->get<std::string>());
  if (!ends)
    throw ConfigError("the run has not begun, or has just ended; only stop reaches it now");
  ::kill(process, SIGTERM);
  return {{"ok", true}, {"status", {{"text", "told to stop"}}}};
}

}  // namespace vitreo::serve
