// SPDX-License-Identifier: Apache-2.0
#include "devices/links/peer_end.h"

#include "devices/links/file_link.h"
#include "devices/links/serial_line.h"
#include "devices/time/error.h"

#include <array>
#include <fcntl.h>
#include <mutex>
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

/// Bytes that the far end holds back from a sender at most: a kernel's buffer of a port.
constexpr std::size_t kReceiveBuffer = 4096;

/// The line between the kernel's end of the wire and the emulator.
class LineEnd : public PeerEnd {
 public:
  explicit LineEnd(Time per_byte) : in_(per_byte), out_(per_byte) {}
  // The emulator is called without the lock: bytes go on through the wire meanwhile.
  void exchange(BytePeer& peer, Time now) override {
    if (const ByteString heard = heard_by(now); !heard.empty()) peer.receive(heard, now);
    const std::vector<TimedBytes> said = peer.say(now);
    const std::lock_guard lock(mutex_);
    // From the moment at which the peer sent it: a peer that is asked late is not late on the line.
    for (const TimedBytes& sent : said) out_.put(sent.bytes, sent.at);
  }
  Time next() const override {
    const std::lock_guard lock(mutex_);
    return out_.next();
  }

 protected:
  /// False when the other side has closed its end. Never blocks: both ends were made so.
  bool move_bytes(int handle, Time now) {
    std::array<std::uint8_t, kReceiveBuffer> buffer{};
    ssize_t count = -1;
    if (const std::size_t on_it = in_.on_the_way(); on_it < buffer.size()) {
      count = ::read(handle, buffer.data(), buffer.size() - on_it);
      if (count > 0) in_.put({buffer.data(), static_cast<std::size_t>(count)}, now);
    }
    const ByteString arrived = out_.arrived(now);
    unsent_.insert(unsent_.end(), arrived.begin(), arrived.end());
    if (!unsent_.empty()) {
      // What the kernel does not take now goes out at the next call.
      const std::ptrdiff_t written = write_quietly(handle, unsent_);
      if (written > 0) unsent_.erase(unsent_.begin(), unsent_.begin() + written);
    }
    return count != 0;
  }
  /// What was on its way to a program that has gone.
  void forget() {
    out_.clear();
    unsent_.clear();
  }
  mutable std::mutex mutex_;

 private:
  ByteString heard_by(Time now) {
    const std::lock_guard lock(mutex_);
    return in_.arrived(now);
  }

  SerialLine in_;
  SerialLine out_;
  ByteString unsent_;
};

/// A read of the master gives EIO once the last program has closed the slave. That is no end, since
/// another may open it later, so what move_bytes() returns is not used.
class PtyEnd final : public LineEnd {
 public:
  explicit PtyEnd(Time per_byte)
      : LineEnd(per_byte),
        master_(owned(::posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC), "pseudo-terminal")) {
    std::array<char, 128> name{};
    const int handle = master_->handle();
    if (::grantpt(handle) != 0 || ::unlockpt(handle) != 0 ||
        ::ptsname_r(handle, name.data(), name.size()) != 0)
      throw DeviceError(DeviceErrorKind::refused, "pseudo-terminal", system_error());
    ::fcntl(handle, F_SETFL, O_NONBLOCK);
    address_ = std::string("serial:") + name.data();
  }
  const std::string& address() const override { return address_; }
  void transfer(Time now) override {
    const std::lock_guard lock(mutex_);
    move_bytes(master_->handle(), now);
  }

 private:
  std::unique_ptr<OpenFile> master_;
  std::string address_;
};

/// One connection at a time; the next is accepted when the last has ended.
class TcpEnd final : public LineEnd {
 public:
  explicit TcpEnd(int port)
      : LineEnd(Time::zero()),
        listener_(owned(::socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0), "tcp")) {
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
  void transfer(Time now) override {
    const std::lock_guard lock(mutex_);
    if (!connection_) {
      const int handle =
          ::accept4(listener_->handle(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
      if (handle < 0) return;
      connection_ = own_descriptor(handle);
    }
    if (move_bytes(connection_->handle(), now)) return;
    connection_.reset();
    forget();  // it answers questions of the program that has gone
  }

 private:
  std::unique_ptr<OpenFile> listener_;
  std::unique_ptr<OpenFile> connection_;
  std::string address_;
};

}  // namespace

std::unique_ptr<PeerEnd> open_pty_end(Time per_byte) { return std::make_unique<PtyEnd>(per_byte); }
std::unique_ptr<PeerEnd> open_tcp_end(int port) { return std::make_unique<TcpEnd>(port); }

}  // namespace vitreo
