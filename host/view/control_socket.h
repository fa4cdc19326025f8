// Control socket: a Unix socket with JSON lines, by which programs on this machine follow and steer
// a running run.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/session/face.h"
#include "host/session/operator_desk.h"

#include <nlohmann/json.hpp>

#include <filesystem>
#include <memory>
#include <string>

namespace vitreo {

/// Answers one request of a client: {"do": "status"} or a word of OperatorDesk: "pause" ("at": a
/// checkpoint), "resume" ("override": although the run is suspended, which wants a researcher),
/// "stop", "abort", "emergency", "answer" ("text"), "ack" ("alarm": its name; without it all),
/// "target" ("positions": [[x, y, z], ...] in m, world), "adjust" ("instrument": its name in the
/// status, "to": a number, SI; without both all are read). "by" says who asks. The reply has "ok",
/// and "status" or "error". Never throws.
nlohmann::json answer_request(const std::string& line, OperatorDesk& desk);

/// Serves while it lives. `{"do": "watch"}` makes a client get each change of the status. A client
/// that sends lines longer than 64 KiB, or does not read, is dropped: nothing here waits for a
/// client.
class ControlSocket {
 public:
  /// Throws std::runtime_error naming the file when it cannot listen there. Borrows the desk.
  ControlSocket(const std::filesystem::path& path, OperatorDesk& desk);
  ~ControlSocket();
  ControlSocket(const ControlSocket&) = delete;
  ControlSocket& operator=(const ControlSocket&) = delete;

 private:
  struct Server;
  std::unique_ptr<Server> server_;
};

/// The socket of each run, under the run's name (control_socket_path). A run goes on without one
/// where it cannot be had; its record says so.
class ControlFace final : public Face {
 public:
  void begin(Session& session) override;
  void end(const std::string& outcome) override;

 private:
  std::unique_ptr<ControlSocket> socket_;
};

}  // namespace vitreo
