// SPDX-License-Identifier: Apache-2.0
#include "devices/links/usbtmc_link.h"

#include "devices/links/printable.h"
#include "devices/links/usbtmc_frames.h"
#include "devices/time/error.h"

#include <algorithm>
#include <optional>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

/// Bytes of a message in one transfer, either way.
constexpr std::size_t kTransferSize = 65536;
/// Above any transfer that is asked for, with header and filling: the short packet at its end is
/// then seen as such.
constexpr std::size_t kRoom = kTransferSize + 1024;
constexpr Time kRequestTimeout = std::chrono::seconds(1);
/// Between two questions whether an abort or a clear is over.
constexpr Time kCheckPause = std::chrono::milliseconds(5);
/// For what a device still has in its Bulk-IN buffer.
constexpr Time kDrainTimeout = std::chrono::milliseconds(100);

class UsbtmcLink final : public MessageLink {
 public:
  UsbtmcLink(std::unique_ptr<UsbtmcPipe> pipe, Clock& clock)
      : pipe_(std::move(pipe)), clock_(clock) {
    if (!pipe_) throw std::invalid_argument("pipe: must not be null");
  }
  const std::string& address() const override { return pipe_->address(); }

  void write(std::span<const std::uint8_t> message, Time timeout) override {
    const Time deadline = later(clock_.now(), timeout);
    const StopShield shield(clock_);
    if (asked_) abort_in(deadline);
    forget();
    do {
      const auto part = message.first(std::min(message.size(), kTransferSize));
      message = message.subspan(part.size());
      send(usbtmc::message_out(new_tag(), part, message.empty()), deadline);
    } while (!message.empty());
  }

  std::optional<ByteString> read(std::size_t most, Time timeout) override {
    const Time deadline = later(clock_.now(), timeout);
    for (;;) {
      if (!asked_) {
        const StopShield shield(clock_);
        send(usbtmc::request_in(new_tag(), kTransferSize), later(clock_.now(), kRequestTimeout));
        asked_ = tag_;
      }
      if (!receive(deadline)) return std::nullopt;
      if (take_transfer(most)) return whole(most);
    }
  }

  // 4.2.1.6 and 4.2.1.7.
  void clear(Time timeout) override {
    const Time deadline = later(clock_.now(), timeout);
    const StopShield shield(clock_);
    const auto started =
        status_of(usbtmc::to_interface(usbtmc::Request::initiate_clear, pipe_->interface_number()),
                  1, "a device clear");
    if (started[0] != usbtmc::success)
      fail(DeviceErrorKind::refused,
           "it refuses a device clear, with status " + std::to_string(started[0]));
    until_done(usbtmc::to_interface(usbtmc::Request::check_clear_status, pipe_->interface_number()),
               2, deadline, "a device clear");
    pipe_->clear_halt(pipe_->out_endpoint());
    asked_.reset();
    forget();
  }

  void reopen() override {
    asked_.reset();
    forget();
    pipe_->reopen();
  }

 private:
  [[noreturn]] void fail(DeviceErrorKind kind, const std::string& what) const {
    throw DeviceError(kind, pipe_->address(), what);
  }
  std::uint8_t new_tag() { return tag_ = usbtmc::next_tag(tag_); }
  void forget() {
    transfer_.clear();
    come_.clear();
    size_ = 0;
  }

  /// A transfer that did not go whole is taken back (4.2.1.2), or the next one would be taken for
  /// its rest.
  void send(const ByteString& transfer, Time deadline) {
    try {
      pipe_->out(transfer, std::max(deadline - clock_.now(), Time::zero()));
    } catch (const DeviceError& error) {
      if (error.kind == DeviceErrorKind::timeout) abort_out();
      if (error.kind == DeviceErrorKind::refused) pipe_->clear_halt(pipe_->out_endpoint());
      throw;
    }
  }

  /// Whether a whole transfer is there.
  bool receive(Time deadline) {
    for (;;) {
      const auto come = pipe_->in(kRoom, std::max(deadline - clock_.now(), Time::zero()));
      transfer_.insert(transfer_.end(), come.bytes.begin(), come.bytes.end());
      if (come.over) return true;
      if (transfer_.size() > kRoom) {
        forget();
        asked_.reset();
        fail(DeviceErrorKind::protocol, "a transfer without an end");
      }
      if (clock_.now() >= deadline) return false;
    }
  }

  /// Adds a transfer's part to the message; true when it was the last.
  bool take_transfer(std::size_t most) {
    const ByteString transfer = std::exchange(transfer_, {});
    const std::uint8_t asked = *std::exchange(asked_, std::nullopt);
    const auto header = usbtmc::parse_header(transfer);
    if (!header || header->id != usbtmc::dev_dep_msg_in || header->tag != asked ||
        header->size > kTransferSize || transfer.size() < usbtmc::kHeader + header->size ||
        (header->size == 0 && !header->end)) {
      forget();
      fail(DeviceErrorKind::protocol,
           "a transfer that does not answer the request: " +
               printable(ByteString(
                   transfer.begin(),
                   transfer.begin() +
                       static_cast<std::ptrdiff_t>(std::min<std::size_t>(24, transfer.size())))));
    }
    size_ += header->size;
    const auto begin = transfer.begin() + static_cast<std::ptrdiff_t>(usbtmc::kHeader);
    if (size_ <= most) come_.insert(come_.end(), begin, begin + header->size);
    return header->end;
  }
  ByteString whole(std::size_t most) {
    const std::size_t size = size_;
    ByteString message = std::exchange(come_, {});
    forget();
    if (size > most)
      fail(DeviceErrorKind::protocol,
           "a message of " + std::to_string(size) + " bytes, more than " + std::to_string(most));
    return message;
  }

  ByteString status_of(const UsbSetup& setup, std::uint16_t length, const std::string& of_what) {
    ByteString answer = pipe_->control(setup, length, kRequestTimeout);
    if (answer.empty())
      fail(DeviceErrorKind::protocol, "it answers the status of " + of_what + " with no bytes");
    answer.resize(std::max<std::size_t>(answer.size(), 2));
    return answer;
  }

  /// Asks until it is done; meanwhile empties Bulk-IN where the device wants that (bit 0 of the
  /// second byte: tables 26 and 33).
  void until_done(const UsbSetup& check, std::uint16_t length, Time deadline,
                  const std::string& of_what) {
    for (;;) {
      const ByteString status = status_of(check, length, of_what);
      if (status[0] != usbtmc::pending) return;
      if (clock_.now() >= deadline)
        fail(DeviceErrorKind::timeout, of_what + " is not over in time");
      if ((status[1] & 1) != 0) drain();
      clock_.sleep_for(kCheckPause);
    }
  }
  void drain() {
    while (!pipe_->in(kRoom, kDrainTimeout).bytes.empty()) {
    }
  }

  // 4.2.1.4 and 4.2.1.5. Where the device has begun none, there is nothing to take back.
  void abort_in(Time deadline) {
    const std::uint8_t endpoint = pipe_->in_endpoint();
    const std::uint8_t tag = *std::exchange(asked_, std::nullopt);
    const auto started =
        status_of(usbtmc::to_endpoint(usbtmc::Request::initiate_abort_bulk_in, endpoint, tag), 2,
                  "the end of a read");
    if (started[0] == usbtmc::failed) return;
    drain();
    if (started[0] == usbtmc::success)
      until_done(usbtmc::to_endpoint(usbtmc::Request::check_abort_bulk_in_status, endpoint), 8,
                 deadline, "the end of a read");
  }
  void abort_out() {
    const std::uint8_t endpoint = pipe_->out_endpoint();
    const auto started =
        status_of(usbtmc::to_endpoint(usbtmc::Request::initiate_abort_bulk_out, endpoint, tag_), 2,
                  "the end of a write");
    if (started[0] == usbtmc::success)
      until_done(usbtmc::to_endpoint(usbtmc::Request::check_abort_bulk_out_status, endpoint), 8,
                 later(clock_.now(), kRequestTimeout), "the end of a write");
    pipe_->clear_halt(endpoint);
  }

  const std::unique_ptr<UsbtmcPipe> pipe_;
  Clock& clock_;
  std::uint8_t tag_ = 0;
  std::optional<std::uint8_t> asked_;  // tag of the request that is not answered yet
  ByteString transfer_;                // of a transfer that is not whole yet
  ByteString come_;                    // of a message that is not whole yet
  std::size_t size_ = 0;               // its bytes so far, with those beyond what is wanted
};

}  // namespace

std::unique_ptr<MessageLink> usbtmc_link(std::unique_ptr<UsbtmcPipe> pipe, Clock& clock) {
  return std::make_unique<UsbtmcLink>(std::move(pipe), clock);
}

std::unique_ptr<MessageLink> open_usbtmc(const std::string& place, Clock& clock) {
  return usbtmc_link(open_usbtmc_pipe(place, clock), clock);
}

}  // namespace vitreo
