// A web client of tests: HTTP and WebSocket by the byte.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <string>
#include <sys/socket.h>
#include <unistd.h>

namespace vitreo::view {

/// A connection that says what it is told, byte by byte.
class Wire {
 public:
  explicit Wire(unsigned short port) : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in address = {};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  }
  ~Wire() { close(socket_); }
  Wire(const Wire&) = delete;
  Wire& operator=(const Wire&) = delete;
  void say(const std::string& bytes) { ::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL); }
  void finish() { shutdown(socket_, SHUT_WR); }
  /// What comes until the other side closes, or `until` has come, or 5 s have passed.
  std::string hear(const std::string& until = "") {
    std::string heard;
    while (until.empty() || heard.find(until) == std::string::npos) {
      pollfd watched{socket_, POLLIN, 0};
      if (poll(&watched, 1, 5000) <= 0) return heard;
      char bytes[65536];
      const ssize_t count = recv(socket_, bytes, sizeof bytes, 0);
      if (count <= 0) {
        closed_ = true;
        return heard;
      }
      heard.append(bytes, static_cast<std::size_t>(count));
    }
    return heard;
  }
  bool closed() const { return closed_; }

 private:
  int socket_;
  bool closed_ = false;
};

/// A client's frame: masked, with a mask of zero.
inline std::string frame(unsigned char opcode, const std::string& payload) {
  std::string bytes(1, static_cast<char>(0x80 | opcode));
  if (payload.size() < 126) {
    bytes += static_cast<char>(0x80 | payload.size());
  } else {
    bytes += static_cast<char>(0x80 | 126);
    bytes += static_cast<char>(payload.size() >> 8);
    bytes += static_cast<char>(payload.size() & 0xff);
  }
  return bytes + std::string(4, '\0') + payload;
}

/// The request that opens the live view's socket: `more` are further lines, `host` as in
/// "127.0.0.1:8080".
inline std::string upgrade_request(const std::string& host, const std::string& origin,
                                   const std::string& more) {
  return "GET /live HTTP/1.1\r\nHost: " + host +
         "\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
         "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n" +
         (origin.empty() ? "" : "Origin: " + origin + "\r\n") + more + "\r\n";
}

}  // namespace vitreo::view
