// Faces of a run that is started here: the control socket always, the page where it is asked for.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/cli/program.h"
#include "host/view/control_socket.h"
#include "host/view/live_view.h"

#include <optional>

namespace vitreo::cli {

class Faces {
 public:
  /// The page listens from here on, before anything of the run is opened or written. Throws
  /// ConfigError where it cannot.
  Faces(const RunOptions& options, ProgressListener& terminal) : listener_(&terminal) {
    if (!options.view.on) return;
    page_.emplace(options.view, terminal);
    listener_ = &page_->listener();
  }
  /// The request with these faces.
  RunRequest of(RunRequest request) {
    request.how.faces.push_back(&socket_);
    if (page_) request.how.faces.push_back(&*page_);
    return request;
  }
  /// Where the script's words go: to the terminal, and to the page.
  ProgressListener& listener() { return *listener_; }

 private:
  ProgressListener* listener_;
  ControlFace socket_;
  std::optional<view::LiveView> page_;
};

}  // namespace vitreo::cli
