// Live topics of a run by the Foxglove WebSocket protocol, read-only: what Foxglove, Lichtblick and
// their kin show while it goes on. The topics are those of the export (host/channels).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/session/face.h"
#include "host/session/session.h"
#include "host/view/admission.h"

#include <memory>
#include <string>

namespace vitreo::view {

/// Outlives the session that it shows.
class FoxgloveView final : public Face {
 public:
  /// Listens at once. Throws ConfigError as check() and shared_token() do, and for an address at
  /// which it cannot listen.
  FoxgloveView(const ViewRequest& request, ProgressListener& terminal);
  ~FoxgloveView() override;
  /// Stands before the terminal: what the script says goes to both.
  ProgressListener& listener();
  /// Shows this session from now on, and prints the address at the terminal.
  void begin(Session& session) override;
  /// No thread of the view touches the session after this. `outcome` is sent to the clients.
  void end(const std::string& outcome) override;
  /// "ws://127.0.0.1:8765/?token=...": with the token that admits a client, or naming the file that
  /// holds it.
  std::string address() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace vitreo::view
