// SPDX-License-Identifier: Apache-2.0
#include "devices/links/udp_link.h"

#include "devices/links/file_link.h"
#include "devices/links/host_and_port.h"
#include "devices/links/polling.h"
#include "devices/time/error.h"

#include <cerrno>
#include <sys/socket.h>
#include <utility>

namespace vitreo {
namespace {

/// RFC 768 and 791: 65535 less the headers of UDP and of IPv4.
constexpr std::size_t kLargestDatagram = 65507;

// The socket is connected: the kernel then takes datagrams of that sender alone, and reports the
// refusals of its host (ip(7), udp(7)). Null from a loss until reopen().
class UdpLink final : public MessageLink {
 public:
  UdpLink(const std::string& host_and_port, Clock& clock)
      : address_("udp:" + host_and_port),
        to_(split_host_and_port("udp", host_and_port)),
        clock_(clock) {
    reopen();
  }
  const std::string& address() const override { return address_; }

  void write(std::span<const std::uint8_t> message, Time timeout) override {
    if (message.size() > kLargestDatagram)
      throw DeviceError(
          DeviceErrorKind::out_of_range, address_,
          "a datagram has at most 65507 bytes, not " + std::to_string(message.size()));
    const StopShield shield(clock_);
    Polling polling(clock_, timeout);
    while (::send(handle(), message.data(), message.size(), MSG_NOSIGNAL | MSG_DONTWAIT) < 0) {
      if (errno != EAGAIN && errno != ENOBUFS && errno != EINTR) lose(errno);
      if (!polling.again())
        throw DeviceError(DeviceErrorKind::timeout, address_,
                          "it did not take the message in time");
    }
  }

  std::optional<ByteString> read(std::size_t most, Time timeout) override {
    Polling polling(clock_, timeout);
    for (;;) {
      if (auto datagram = receive()) {
        if (datagram->size() <= most) return datagram;
        throw DeviceError(DeviceErrorKind::protocol, address_,
                          "a message of " + std::to_string(datagram->size()) +
                              " bytes, more than " + std::to_string(most));
      }
      if (!polling.again()) return std::nullopt;
    }
  }

  // What has arrived; no more than that: a broken instrument may send without end.
  void clear(Time /*timeout*/) override {
    constexpr int kMost = 10000;
    for (int i = 0; i < kMost && receive(); ++i) {
    }
  }

  void reopen() override {
    file_.reset();
    const Resolved found = resolve(address_, to_, SOCK_DGRAM);
    std::string why;
    for (const addrinfo* one = found.get(); one != nullptr; one = one->ai_next) {
      const int handle = ::socket(one->ai_family, one->ai_socktype | SOCK_NONBLOCK | SOCK_CLOEXEC,
                                  one->ai_protocol);
      std::unique_ptr<OpenFile> file;
      if (handle >= 0) file = own_descriptor(handle);
      if (file && ::connect(handle, one->ai_addr, one->ai_addrlen) == 0) {
        file_ = std::move(file);
        return;
      }
      why = system_error();
    }
    throw DeviceError(DeviceErrorKind::not_found, address_, why);
  }

 private:
  int handle() const {
    if (!file_) throw DeviceError(DeviceErrorKind::lost, address_, "it is closed");
    return file_->handle();
  }

  /// A datagram that has arrived.
  std::optional<ByteString> receive() {
    const ssize_t size = ::recv(handle(), buffer_.data(), buffer_.size(), MSG_DONTWAIT);
    if (size >= 0) return ByteString(buffer_.begin(), buffer_.begin() + size);
    if (errno != EAGAIN && errno != EINTR) lose(errno);
    return std::nullopt;
  }

  [[noreturn]] void lose(int error) {
    errno = error;
    const std::string why = system_error();
    file_.reset();
    throw DeviceError(DeviceErrorKind::lost, address_,
                      error == ECONNREFUSED ? "nothing listens at this port: " + why : why);
  }

  const std::string address_;
  const HostAndPort to_;
  Clock& clock_;
  std::unique_ptr<OpenFile> file_;
  ByteString buffer_ = ByteString(kLargestDatagram);
};

}  // namespace

std::unique_ptr<MessageLink> open_udp(const std::string& host_and_port, Clock& clock) {
  return std::make_unique<UdpLink>(host_and_port, clock);
}

}  // namespace vitreo
