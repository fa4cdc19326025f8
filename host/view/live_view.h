// Live view of a run (thesis figures 6.2, 6.7 and 6.8, and better): a page in the browser that
// shows it, from which an operator can stop it, answer its questions, and point at positions for
// the robot. docs/live_view.md has the protocol.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/session/face.h"
#include "host/session/session.h"
#include "host/view/admission.h"

#include <memory>
#include <string>

namespace vitreo::view {

/// Outlives the session that it shows, but for what begin() gives it.
class LiveView final : public Face {
 public:
  /// Listens at once. Throws ConfigError as check() and shared_token() do, and for an address at
  /// which it cannot listen.
  LiveView(const ViewRequest& request, ProgressListener& terminal);
  ~LiveView() override;
  /// Stands before the terminal: what the script says goes to both.
  ProgressListener& listener();
  /// Shows this session from now on, and prints the invitation at the terminal.
  void begin(Session& session) override;
  /// No thread of the view touches the session after this. `outcome` is sent to the viewers:
  /// "stopped: ...".
  void end(const std::string& outcome) override;
  /// Address of the page: with a token that admits one browser, or naming the file that holds the
  /// token.
  std::string invitation();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace vitreo::view
