// The control socket: what one more program on this machine may ask of a running run. A Unix
// socket, JSON lines.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/config/rights.h"
#include "host/session/alarms.h"
#include "host/session/questions.h"
#include "host/session/run_control.h"

#include <nlohmann/json.hpp>

#include <atomic>
#include <filesystem>
#include <optional>
#include <string>
#include <thread>
#include <vector>

namespace vitreo {

/// Where a run's socket is: in a folder that only this user can enter. Throws std::runtime_error
/// when it cannot be made.
std::filesystem::path control_socket_path(const std::string& run_name);
/// The names of the runs that have a socket now, sorted.
std::vector<std::string> controllable_runs();

/// What else of a run can be reached; null: nothing of the kind.
struct ControlDesk {
  Alarms* alarms = nullptr;
  Rights rights;
};

/// {"phase", "tier", "waiting_for", "note", "text", "progress", "doing"; "remaining", "alarms" and
/// "question" where there are such}: what the socket and the live view say of a run.
nlohmann::json status_json(const RunControl& control, const Questions& questions,
                           const ControlDesk& desk);

/// Answers one request of a client: {"do": "status"}, "pause" ("at": a checkpoint), "resume"
/// ("override": although the run is suspended, which wants a researcher), "stop", "abort",
/// "emergency", "answer" ("text"), "ack" ("alarm": its name; without it all). "by" says who asks.
/// The reply has "ok", and "status" or "error". Never throws.
nlohmann::json answer_request(const std::string& line, RunControl& control, Questions& questions,
                              const ControlDesk& desk = {});

/// Serves while it lives. `{"do": "watch"}` makes a client get each change of the status. A client
/// that sends lines longer than 64 KiB, or does not read, is dropped: nothing here waits for a
/// client.
class ControlSocket {
 public:
  /// Throws std::runtime_error naming the file when it cannot listen there.
  ControlSocket(const std::filesystem::path& path, RunControl& control, Questions& questions,
                const ControlDesk& desk = {});
  ~ControlSocket();
  ControlSocket(const ControlSocket&) = delete;
  ControlSocket& operator=(const ControlSocket&) = delete;

 private:
  struct Client {
    int socket = -1;
    std::string received;
    bool watches = false;
  };
  void serve();
  void accept_client();
  bool take(Client& client);
  bool send(const Client& client, const nlohmann::json& message);
  void tell_watchers();

  const std::filesystem::path path_;
  RunControl& control_;
  Questions& questions_;
  const ControlDesk desk_;
  int listener_ = -1;
  std::vector<Client> clients_;
  unsigned long told_ = 0;
  std::atomic<bool> done_{false};
  std::thread thread_;
};

/// Sends one request to a run and returns its reply. `run` is a run's name or the beginning of one;
/// empty: the only one there is. Throws std::runtime_error saying what there is to choose from, or
/// that nobody answered within 5 s.
nlohmann::json control_run(const std::string& run, const nlohmann::json& request);

/// A program that stays connected to a run and follows it.
class ControlConnection {
 public:
  /// Throws as control_run.
  explicit ControlConnection(const std::string& run);
  ~ControlConnection();
  ControlConnection(const ControlConnection&) = delete;
  ControlConnection& operator=(const ControlConnection&) = delete;
  const std::string& name() const { return name_; }
  int descriptor() const { return socket_; }
  void send(
      const nlohmann::json& request);  ///< throws std::runtime_error when the run does not take it
  bool receive();                      ///< takes what has come; false when the run is gone
  std::optional<nlohmann::json> next();  ///< a whole message that has come

 private:
  int socket_ = -1;
  std::string name_, received_;
};

}  // namespace vitreo
