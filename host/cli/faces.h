// Faces of a run that is started here: the control socket always, the page and Foxglove's topics
// where they are asked for.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/cli/program.h"
#include "host/view/control_socket.h"
#include "host/view/foxglove_view.h"
#include "host/view/instrument_panel.h"
#include "host/view/live_view.h"

#include <optional>

namespace vitreo::cli {

class Faces {
 public:
  /// Page and topics are served from here on, before anything of the run is opened or written.
  /// Throws ConfigError where it cannot.
  Faces(const RunOptions& options, ProgressListener& terminal) : listener_(&terminal) {
    if (options.view.on) {
      page_.emplace(options.view, *listener_);
      listener_ = &page_->listener();
    }
    if (options.foxglove.on) {
      foxglove_.emplace(options.foxglove, *listener_);
      listener_ = &foxglove_->listener();
    }
  }
  /// The request with these faces.
  RunRequest of(RunRequest request) {
    request.how.faces.push_back(&panel_);
    request.how.faces.push_back(&socket_);
    if (page_) request.how.faces.push_back(&*page_);
    if (foxglove_) request.how.faces.push_back(&*foxglove_);
    return request;
  }
  /// Where the script's words go: to the terminal, and to the page.
  ProgressListener& listener() { return *listener_; }

 private:
  ProgressListener* listener_;
  view::PanelFace panel_;
  ControlFace socket_;
  std::optional<view::LiveView> page_;
  std::optional<view::FoxgloveView> foxglove_;
};

}  // namespace vitreo::cli
