// Routes of the workbench: its REST interface, address by address. docs/reference/openapi.json
// describes it for programs.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/serve/dispatcher.h"
#include "host/serve/forms.h"
#include "host/serve/job_queue.h"
#include "host/serve/shelf.h"
#include "host/view/web_request.h"

#include <string>
#include <utility>
#include <vector>

namespace vitreo::serve {

/// What the workbench is made of; borrowed.
struct Parts {
  JobQueue& queue;
  Dispatcher& dispatcher;
  Forms& forms;
  Shelf& shelf;
  std::filesystem::path messages;  // the settings file
  std::string live_token{};        // with which a browser gets into a live view
  std::string version{};
};

/// The answer; never throws. Any thread. A mistake of the request is 400 with {"error": text}.
view::WebReply answer(const view::WebRequest& request, Parts& parts);

/// What all pages show, and what is sent to them at each change: {"name", "version", "held",
/// "why_held", "waiting", "running", "ended", "messages"}.
nlohmann::json state_of(Parts& parts);

/// Method and path of every route, "POST /api/queue/{id}/start".
std::vector<std::string> route_names();

/// Whether it steers a run: such a request never waits behind others.
bool is_urgent(const view::WebRequest& request);

}  // namespace vitreo::serve
