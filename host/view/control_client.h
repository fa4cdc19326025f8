// Client of the control sockets of runs on this machine: JSON lines over a Unix socket.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace vitreo {

/// A run's socket, in a folder that only this user can enter. Throws std::runtime_error when that
/// cannot be made.
std::filesystem::path control_socket_path(const std::string& run_name);
/// The names of the runs that have a socket now, sorted.
std::vector<std::string> controllable_runs();

/// Sends one request to a run and returns its reply. `run` is a run's name or the beginning of one;
/// empty: the only one there is. Throws ConfigError saying what there is to choose from,
/// std::runtime_error when there is no answer within 5 s.
nlohmann::json control_run(const std::string& run, const nlohmann::json& request);

/// A program that stays connected to a run and follows it.
class ControlConnection {
 public:
  /// Throws as control_run.
  explicit ControlConnection(const std::string& run);
  ~ControlConnection();
  ControlConnection(const ControlConnection&) = delete;
  ControlConnection& operator=(const ControlConnection&) = delete;
  const std::string& name() const;
  int descriptor() const;  // for poll()
  /// Throws std::runtime_error when the run does not take it.
  void send(const nlohmann::json& request);
  bool receive();                        // takes what has come; false when the run is gone
  std::optional<nlohmann::json> next();  // a whole message that has come

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace vitreo
