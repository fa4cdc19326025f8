// Web request and reply: what a server's handler is given for an address that is no file, and what
// it answers.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

namespace vitreo::view {

/// Of a browser or program that was admitted.
struct WebRequest {
  std::string method;  // "GET" also for HEAD
  std::string target;  // "/api/queue?x=1", as it was sent
  std::string body;    // of up to 64 kB
};

struct WebReply {
  int status = 200;
  std::string body{};
  std::string type = "application/json";
  /// In place of the headers of that name which every answer has.
  std::vector<std::pair<std::string, std::string>> headers{};
};

/// Gives the reply to its request: once, from any thread, and not after the server is gone.
using SendReply = std::function<void(WebReply)>;
using RequestHandler = std::function<void(WebRequest, SendReply)>;

}  // namespace vitreo::view
