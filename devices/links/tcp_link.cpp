// SPDX-License-Identifier: Apache-2.0
#include "devices/links/tcp_link.h"

#include "devices/links/file_link.h"
#include "devices/links/host_and_port.h"
#include "devices/time/error.h"

#include <algorithm>
#include <cerrno>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <utility>

namespace vitreo {
namespace {

/// After which bytes that were not acknowledged mean that the far end is gone (RFC 5482).
constexpr int kUserTimeout_ms = 500;
/// How often a connection under way is polled.
constexpr Time kSlice = std::chrono::milliseconds(1);

/// Waits for a connection under way. Empty when it stands, else why not.
/// poll() with no time of its own, and sleeps on the clock: other tasks go on meanwhile.
std::string connected(int handle, Time deadline, Clock& clock) {
  for (;;) {
    pollfd file{handle, POLLOUT, 0};
    // connect(2): a socket that became writable has its result in SO_ERROR.
    if (::poll(&file, 1, 0) > 0) {
      int error = 0;
      socklen_t size = sizeof error;
      ::getsockopt(handle, SOL_SOCKET, SO_ERROR, &error, &size);
      errno = error;
      return error == 0 ? "" : system_error();
    }
    if (clock.now() >= deadline) return "no answer in time";
    clock.sleep_for(std::min(kSlice, deadline - clock.now()));
  }
}

/// No delay: commands are short, and Nagle's algorithm would hold each back until the one before is
/// acknowledged, up to 40 ms.
void configure(int handle) {
  const int yes = 1;
  const int user_timeout = kUserTimeout_ms;
  ::setsockopt(handle, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
  ::setsockopt(handle, IPPROTO_TCP, TCP_USER_TIMEOUT, &user_timeout, sizeof user_timeout);
}

std::unique_ptr<OpenFile> connect(const std::string& address, const HostAndPort& to, Time timeout,
                                  Clock& clock) {
  const auto fail = [&address](DeviceErrorKind kind, const std::string& what) {
    throw DeviceError(kind, address, what);
  };
  // Blocks, with the baton, where the host is a name and no number.
  const Resolved found = resolve(address, to, SOCK_STREAM);
  const Time deadline = later(clock.now(), timeout);
  std::string why;
  // A name may have several addresses, of IPv6 and IPv4: the first that answers. The error is that
  // of the last one.
  for (const addrinfo* one = found.get(); one != nullptr; one = one->ai_next) {
    const int handle =
        ::socket(one->ai_family, one->ai_socktype | SOCK_NONBLOCK | SOCK_CLOEXEC, one->ai_protocol);
    if (handle < 0) {
      why = system_error();
      continue;
    }
    auto file = own_descriptor(handle);
    configure(handle);
    if (::connect(handle, one->ai_addr, one->ai_addrlen) == 0) return file;
    why = errno == EINPROGRESS ? connected(handle, deadline, clock) : system_error();
    if (why.empty()) return file;
  }
  fail(clock.now() >= deadline ? DeviceErrorKind::timeout : DeviceErrorKind::not_found, why);
  return nullptr;
}

}  // namespace

std::unique_ptr<ByteLink> open_tcp(const std::string& host_and_port, Time timeout, Clock& clock) {
  const HostAndPort to = split_host_and_port("tcp", host_and_port);
  const std::string address = "tcp:" + host_and_port;
  return file_link(
      address, "", [=, &clock] { return connect(address, to, timeout, clock); }, clock);
}

}  // namespace vitreo
