// SPDX-License-Identifier: Apache-2.0
#include "devices/links/peer_end.h"

#include "devices/links/file_link.h"
#include "devices/time/error.h"

#include <array>
#include <fcntl.h>
#include <netinet/in.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <unistd.h>
#include <utility>

namespace vitreo {
namespace {

/// Owns what a system call returned, or throws its error.
std::unique_ptr<OpenFile> owned(int handle, const char* what) {
  if (handle < 0) throw DeviceError(DeviceErrorKind::refused, what, system_error());
  return own_descriptor(handle);
}

/// False when the other side has closed its end.
/// Never blocks: both ends were made so. Bytes that the kernel does not take stay in `unsent`.
bool pump_bytes(int handle, BytePeer& peer, Time now, ByteString& unsent) {
  std::array<std::uint8_t, 4096> buffer{};
  const ssize_t count = ::read(handle, buffer.data(), buffer.size());
  if (count > 0) peer.receive({buffer.data(), static_cast<std::size_t>(count)}, now);
  for (const TimedBytes& sent : peer.say(now))
    unsent.insert(unsent.end(), sent.bytes.begin(), sent.bytes.end());
  if (!unsent.empty()) {
    // What the kernel does not take now goes out at the next call.
    const std::ptrdiff_t written = write_quietly(handle, unsent);
    if (written > 0) unsent.erase(unsent.begin(), unsent.begin() + written);
  }
  return count != 0;
}

/// A read of the master gives EIO once the last program has closed the slave. That is no end, since
/// another may open it later, so what pump_bytes() returns is not used.
class PtyEnd final : public PeerEnd {
 public:
  PtyEnd() : master_(owned(::posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC), "pseudo-terminal")) {
    std::array<char, 128> name{};
    const int handle = master_->handle();
    if (::grantpt(handle) != 0 || ::unlockpt(handle) != 0 ||
        ::ptsname_r(handle, name.data(), name.size()) != 0)
      throw DeviceError(DeviceErrorKind::refused, "pseudo-terminal", system_error());
    ::fcntl(handle, F_SETFL, O_NONBLOCK);
    address_ = std::string("serial:") + name.data();
  }
  const std::string& address() const override { return address_; }
  void pump(BytePeer& peer, Time now) override {
    pump_bytes(master_->handle(), peer, now, unsent_);
  }

 private:
  std::unique_ptr<OpenFile> master_;
  std::string address_;
  ByteString unsent_;
};

/// One connection at a time; the next is accepted when the last has ended.
class TcpEnd final : public PeerEnd {
 public:
  explicit TcpEnd(int port)
      : listener_(owned(::socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0), "tcp")) {
    sockaddr_in here{};
    here.sin_family = AF_INET;
    here.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    here.sin_port = htons(static_cast<std::uint16_t>(port));
    auto* const generic = reinterpret_cast<sockaddr*>(&here);
    socklen_t size = sizeof here;
    const int handle = listener_->handle();
    const int yes = 1;
    // The same port again at once, not after the minute of TIME_WAIT.
    ::setsockopt(handle, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    if (::bind(handle, generic, size) != 0 || ::listen(handle, 1) != 0 ||
        ::getsockname(handle, generic, &size) != 0)
      throw DeviceError(DeviceErrorKind::refused, "tcp:127.0.0.1:" + std::to_string(port),
                        system_error());
    address_ = "tcp:127.0.0.1:" + std::to_string(ntohs(here.sin_port));
  }
  const std::string& address() const override { return address_; }

  // One pass does what is possible now; the owner calls again.
  void pump(BytePeer& peer, Time now) override {
    if (!connection_) {
      const int handle =
          ::accept4(listener_->handle(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
      if (handle < 0) return;
      connection_ = own_descriptor(handle);
    }
    if (pump_bytes(connection_->handle(), peer, now, unsent_)) return;
    connection_.reset();
    unsent_.clear();  // it answers questions of the program that has gone
  }

 private:
  std::unique_ptr<OpenFile> listener_;
  std::unique_ptr<OpenFile> connection_;
  std::string address_;
  ByteString unsent_;
};

}  // namespace

std::unique_ptr<PeerEnd> open_pty_end() { return std::make_unique<PtyEnd>(); }
std::unique_ptr<PeerEnd> open_tcp_end(int port) { return std::make_unique<TcpEnd>(port); }

}  // namespace vitreo
