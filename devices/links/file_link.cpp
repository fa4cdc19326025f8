// SPDX-License-Identifier: Apache-2.0
#include "devices/links/file_link.h"

#include "devices/links/polling.h"
#include "devices/time/error.h"

#include <algorithm>
#include <cerrno>
#include <poll.h>
#include <sys/socket.h>
#include <system_error>
#include <unistd.h>
#include <utility>

namespace vitreo {
namespace {

constexpr std::size_t kMostAtOnce = 4096;

class Descriptor final : public OpenFile {
 public:
  explicit Descriptor(int handle) : handle_(handle) {}
  ~Descriptor() override { ::close(handle_); }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  int handle() const override { return handle_; }

 private:
  int handle_;
};

// From a loss until reopen() there is no file, and every call throws DeviceError{lost}.
class FileLink final : public ByteLink {
 public:
  FileLink(std::string address, std::string settings,
           std::function<std::unique_ptr<OpenFile>()> open, Clock& clock)
      : address_(std::move(address)),
        settings_(std::move(settings)),
        open_(std::move(open)),
        clock_(clock),
        file_(open_()) {}

  const std::string& address() const override { return address_; }
  std::string description() const override { return address_ + settings_; }

  void write(std::span<const std::uint8_t> bytes, Time timeout) override {
    // Half a command on the wire would confuse the instrument; the deadline ends it soon enough.
    const StopShield shield(clock_);
    Polling polling(clock_, timeout);
    while (!bytes.empty()) {
      // A port that is gone can still take bytes into the kernel's buffer.
      if (poll_for(POLLOUT)) {
        const std::ptrdiff_t written = write_quietly(file_->handle(), bytes);
        if (written > 0) {
          bytes = bytes.subspan(static_cast<std::size_t>(written));
          continue;
        }
        if (written < 0 && errno != EAGAIN && errno != EINTR) lose(system_error());
      }
      if (!polling.again())
        throw DeviceError(DeviceErrorKind::timeout, address_, "it did not take the bytes in time");
    }
  }

  ByteString read(std::size_t most, Time timeout) override {
    Polling polling(clock_, timeout);
    for (;;) {
      if (poll_for(POLLIN)) {
        ByteString bytes(std::min(most, kMostAtOnce));
        const ssize_t count = ::read(file_->handle(), bytes.data(), bytes.size());
        // poll() reported something to read, so none is the end: a socket was shut down, or a port
        // hung up.
        if (count == 0) lose("the far end is gone");
        if (count > 0) {
          bytes.resize(static_cast<std::size_t>(count));
          return bytes;
        }
        if (errno != EAGAIN && errno != EINTR) lose(system_error());
      }
      if (!polling.again()) return {};
    }
  }

  bool hung_up() const override {
    if (!file_) return true;
    pollfd file{file_->handle(), POLLRDHUP, 0};
    return ::poll(&file, 1, 0) > 0;  // POLLERR, POLLHUP and POLLNVAL come unasked
  }

  // Closed first: a port with one owner would refuse the second opening.
  void reopen() override {
    file_.reset();
    file_ = open_();
  }

 private:
  /// Whether `event` (POLLIN, POLLOUT) can be served now. What had arrived before the far end went
  /// may still be read.
  bool poll_for(short event) {
    if (!file_) lose("it is closed");
    pollfd file{file_->handle(), static_cast<short>(event | POLLRDHUP), 0};
    if (::poll(&file, 1, 0) < 0 && errno != EINTR) lose(system_error());
    if ((file.revents & POLLIN) != 0 && event == POLLIN) return true;
    if ((file.revents & (POLLERR | POLLHUP | POLLRDHUP | POLLNVAL)) != 0)
      lose("the far end is gone");
    return (file.revents & event) != 0;
  }

  /// Closes at once: a terminal that was hung up stays so, even when its cable comes back.
  [[noreturn]] void lose(const std::string& what) {
    file_.reset();
    throw DeviceError(DeviceErrorKind::lost, address_, what);
  }

  const std::string address_;
  const std::string settings_;
  const std::function<std::unique_ptr<OpenFile>()> open_;
  Clock& clock_;
  std::unique_ptr<OpenFile> file_;  // null once it was lost
};

}  // namespace

std::unique_ptr<OpenFile> own_descriptor(int handle) {
  return std::make_unique<Descriptor>(handle);
}

std::unique_ptr<ByteLink> file_link(std::string address, std::string settings,
                                    std::function<std::unique_ptr<OpenFile>()> open, Clock& clock) {
  return std::make_unique<FileLink>(std::move(address), std::move(settings), std::move(open),
                                    clock);
}

// MSG_NOSIGNAL exists for sockets alone; everything else is written to plainly.
std::ptrdiff_t write_quietly(int handle, std::span<const std::uint8_t> bytes) {
  const std::ptrdiff_t sent = ::send(handle, bytes.data(), bytes.size(), MSG_NOSIGNAL);
  return sent < 0 && errno == ENOTSOCK ? ::write(handle, bytes.data(), bytes.size()) : sent;
}

// Reads errno, so it is called before anything else that may set it.
std::string system_error() { return std::generic_category().message(errno); }

}  // namespace vitreo
