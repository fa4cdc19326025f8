// Web server of the live view: a table of files and one WebSocket, for browsers that a token has
// admitted; or a WebSocket alone, for programs that speak a subprotocol. It has a thread of its own
// and never waits for a viewer. Boost.Beast is included by web_server.cpp alone.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/view/web_request.h"

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace vitreo::view {

/// A file of the page, as the build embedded it.
struct Asset {
  std::string path;        // "/assets/index.js"
  std::string type;        // "text/javascript"
  std::string_view bytes;  // gzipped where `gzip` is set
  bool gzip = false;
};

struct ServerSettings {
  std::string address = "127.0.0.1";
  unsigned short port = 0;  // 0: any that is free
  std::vector<Asset> assets;
  std::size_t most_viewers = 32;
  /// Admits any number of browsers, any number of times; empty: there is none.
  std::string shared_token{};
  /// With a request that does not come whole, and with a viewer that is silent.
  std::chrono::milliseconds patience = std::chrono::seconds(10);
  /// Where there are some: no files; a WebSocket at any path that offers one of them is admitted by
  /// "?token=" and the shared token in its address, the first of them that it offers chosen.
  std::vector<std::string> subprotocols{};
  /// Of the browsers' cookie: they keep those of all ports of a host together, so each server of a
  /// machine wants its own.
  std::string cookie = "vitreo";
  /// A link in a mail or a file may open the page of a browser that was admitted: SameSite=Lax
  /// instead of Strict. What changes something checks its origin in any case.
  bool opened_by_links = false;
  /// Answers what is no file; called on the server's thread, and does not wait. What would change
  /// something (any method but GET and HEAD) reaches it from our own page or with a bearer token
  /// alone, which may be the shared token. Empty: only GET, and only files.
  RequestHandler handler{};
};

/// 128 bits from the system's generator, as 32 hexadecimal digits.
std::string random_token();

class WebServer {
 public:
  /// All of them are called on the server's thread, which also is the only one that may call send()
  /// and the like.
  struct Callbacks {
    std::function<void(int viewer)> joined;
    std::function<void(int viewer)> left;
    std::function<void(int viewer, const std::string& message)> received;  // text of up to 64 kB
    std::function<void()> tick;                                            // each 10 ms
    /// HTML of a path that is none of the assets', for who was admitted; empty where there is none.
    /// It may hold styles and a script of its own, and loads nothing.
    std::function<std::string(std::string_view path)> document{};
  };

  /// Listens, and serves until it is destroyed. Throws std::runtime_error naming the address.
  WebServer(ServerSettings settings, Callbacks callbacks);
  ~WebServer();
  WebServer(const WebServer&) = delete;
  WebServer& operator=(const WebServer&) = delete;

  unsigned short port() const;
  std::string address() const;  // "http://127.0.0.1:38911/"
  /// An address with a new token in it: it admits one browser, once. Any thread.
  std::string invitation();

  /// A viewer that is more than 1 MB of text behind is dropped.
  void send(int viewer, const std::string& text);
  /// Of each slot only the newest waits to be sent: a slow viewer sees fewer frames, not older
  /// ones.
  void send_frame(int viewer, int slot, std::shared_ptr<const std::string> bytes);
  /// Binary, in order. What finds 4 MB waiting takes the place of the oldest that wait.
  void send_data(int viewer, std::shared_ptr<const std::string> bytes);
  /// Messages of send_data() that gave way, since the viewer joined.
  std::uint64_t dropped(int viewer) const;
  /// Whether the viewer's last frame of that slot is on its way: encoding another one would be in
  /// vain.
  bool busy(int viewer, int slot) const;
  std::vector<int> viewers() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace vitreo::view
