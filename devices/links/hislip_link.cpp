// SPDX-License-Identifier: Apache-2.0
#include "devices/links/hislip_link.h"

#include "devices/links/hislip_messages.h"
#include "devices/links/node_lock.h"
#include "devices/links/tcp_link.h"
#include "devices/time/error.h"

#include <algorithm>
#include <utility>

namespace vitreo {
namespace {

constexpr Time kHislipPatience = std::chrono::seconds(2);
/// Version 1.0, and no maker that the standard knows.
constexpr std::uint32_t kVersionAndVendor = 0x01000000 | 'X' << 8 | 'X';
constexpr std::uint32_t kFirstNumber = 0xFFFFFF00;  ///< of a message; the next are 2 apart (3.1.2)
constexpr std::uint32_t kNoNumber = 0xFFFFFFFF;
/// A server that says less is mistaken.
constexpr std::uint64_t kLeastPayload = 256;

std::string text_in(const hislip::Message& message) {
  return {message.payload.begin(), message.payload.end()};
}

// In synchronized mode an answer has the number of its question; in overlapped mode (table 10) the
// server counts its own.
class HislipLink final : public MessageLink {
  using Message = hislip::Message;
  using Type = hislip::Type;

 public:
  HislipLink(std::string address, InstrumentPlace place,
             std::function<std::unique_ptr<ByteLink>()> connect, Clock& clock)
      : address_(std::move(address)),
        place_(std::move(place)),
        connect_(std::move(connect)),
        clock_(clock) {
    open();
  }

  const std::string& address() const override { return address_; }
  std::string description() const override {
    return address_ + (locked_ ? "" : " (which knows no locks)");
  }

  // In parts that the server takes; each has a number, and the last ends the message (table 9).
  void write(std::span<const std::uint8_t> message, Time timeout) override {
    const Time deadline = later(clock_.now(), timeout);
    const StopShield shield(clock_);
    guarded([&] {
      listen();
      come_.clear();
      size_ = 0;
      for (;;) {
        const auto part = message.first(std::min<std::size_t>(message.size(), payload_size_));
        const bool last = part.size() == message.size();
        asked_ = next_number_;
        next_number_ += 2;
        sync().send({last ? Type::data_end : Type::data,
                     std::exchange(delivered_, std::uint8_t{0}),
                     asked_,
                     {part.begin(), part.end()}},
                    std::max(deadline - clock_.now(), Time::zero()));
        message = message.subspan(part.size());
        if (last) return;
      }
    });
  }

  std::optional<ByteString> read(std::size_t most, Time timeout) override {
    const Time deadline = later(clock_.now(), timeout);
    return guarded([&]() -> std::optional<ByteString> {
      listen();
      while (const auto message = sync().receive(deadline)) {
        check(*message);
        if (message->type == Type::interrupted) forget();
        if (!is_answer(*message)) continue;
        size_ += message->payload.size();
        if (size_ <= most)
          come_.insert(come_.end(), message->payload.begin(), message->payload.end());
        if (message->type == Type::data_end) return whole(most);
      }
      return std::nullopt;
    });
  }

  // Table 18: over the asynchronous channel first; then all on the synchronous one is dropped up
  // to the acknowledgement, and the numbers begin anew.
  void clear(Time timeout) override {
    const Time deadline = later(clock_.now(), timeout);
    const StopShield shield(clock_);
    guarded([&] {
      async().send({Type::async_device_clear}, timeout);
      wait_for(async(), Type::async_device_clear_acknowledge, deadline);
      sync().send({Type::device_clear_complete}, timeout);
      overlapped_ = (wait_for(sync(), Type::device_clear_acknowledge, deadline).control & 1) != 0;
    });
    begin();
  }

  void reopen() override {
    close();
    open();
  }

 private:
  struct Connection {
    Connection(std::unique_ptr<ByteLink> its_link, Clock& clock)
        : link(std::move(its_link)), channel(*link, clock) {}
    std::unique_ptr<ByteLink> link;
    hislip::Channel channel;
  };

  [[noreturn]] void fail(DeviceErrorKind kind, const std::string& what) const {
    throw DeviceError(kind, address_, what);
  }
  hislip::Channel& sync() { return sync_->channel; }
  hislip::Channel& async() { return async_->channel; }
  void close() {
    sync_.reset();
    async_.reset();
  }
  /// The link is new, or was cleared.
  void begin() {
    next_number_ = kFirstNumber;
    asked_ = kNoNumber;
    delivered_ = 0;
    forget();
  }
  void forget() {
    come_.clear();
    size_ = 0;
  }

  /// An error of one of the connections is the end of both: it is lost, or out of step after half
  /// a message.
  template <class Work>
  auto guarded(const Work& work) -> decltype(work()) {
    if (!async_) fail(DeviceErrorKind::lost, "it is closed");
    try {
      return work();
    } catch (const DeviceError& error) {
      if (error.device != address_) close();
      throw renamed(error, address_);
    }
  }

  void open() {
    begin();
    try {
      const Time deadline = later(clock_.now(), kHislipPatience);
      sync_ = std::make_unique<Connection>(connect_(), clock_);
      const ByteString device(place_.device.begin(), place_.device.end());
      sync().send({Type::initialize, 0, kVersionAndVendor, device}, kHislipPatience);
      const Message session = wait_for(sync(), Type::initialize_response, deadline);
      overlapped_ = (session.control & 1) != 0;
      async_ = std::make_unique<Connection>(connect_(), clock_);
      async().send({Type::async_initialize, 0, session.parameter & 0xFFFF}, kHislipPatience);
      wait_for(async(), Type::async_initialize_response, deadline);
      agree_on_sizes(deadline);
      lock(deadline);
    } catch (const DeviceError& error) {
      close();
      throw renamed(error, address_);
    }
  }

  void agree_on_sizes(Time deadline) {
    async().send(
        {Type::async_maximum_message_size, 0, 0, hislip::size_payload(hislip::kLargestPayload)},
        kHislipPatience);
    const Message answer = wait_for(async(), Type::async_maximum_message_size_response, deadline);
    // Whether it counts the header is read in two ways.
    const std::uint64_t most = hislip::size_in(answer.payload);
    payload_size_ = static_cast<std::size_t>(
        std::clamp(most, kLeastPayload + hislip::kHeader, hislip::kLargestPayload) -
        hislip::kHeader);
  }

  /// Table 13: exclusive, at once or not at all. 0: another has it; 1: ours; 3: it knows none.
  void lock(Time deadline) {
    async().send({Type::async_lock, 1, 0}, kHislipPatience);
    const Message answer = wait_for(async(), Type::async_lock_response, deadline);
    if (answer.control == 0) throw OwnedError(address_);
    locked_ = answer.control == 1;
  }

  Message wait_for(hislip::Channel& channel, Type type, Time deadline) {
    while (auto message = channel.receive(deadline)) {
      if (message->type == type) return *std::move(message);
      check(*message, type == Type::initialize_response);
    }
    fail(DeviceErrorKind::timeout, "it does not answer in time");
  }

  /// Table 16 and 17.
  void check(const Message& message, bool at_opening = false) {
    if (message.type == Type::fatal_error) {
      close();
      fail(at_opening ? DeviceErrorKind::not_found : DeviceErrorKind::lost,
           "it ends the connection with the fatal error " + std::to_string(message.control) + ": " +
               text_in(message));
    }
    if (message.type == Type::error)
      fail(DeviceErrorKind::refused, "it answers with the error " +
                                         std::to_string(message.control) + ": " + text_in(message));
  }

  /// What comes unasked on the asynchronous channel: service requests, interruptions, a fatal
  /// error.
  void listen() {
    while (const auto message = async().receive(clock_.now())) check(*message);
  }

  /// Data of the question that was asked last; what belongs to one before is dropped.
  bool is_answer(const Message& message) const {
    if (message.type != Type::data && message.type != Type::data_end) return false;
    return overlapped_ || message.parameter == asked_ ||
           (message.type == Type::data && message.parameter == kNoNumber);
  }

  ByteString whole(std::size_t most) {
    delivered_ = 1;  // told with the next message (3.1.1, RMT-delivered)
    const std::size_t size = std::exchange(size_, 0);
    ByteString message = std::exchange(come_, {});
    if (size > most)
      fail(DeviceErrorKind::protocol,
           "a message of " + std::to_string(size) + " bytes, more than " + std::to_string(most));
    return message;
  }

  const std::string address_;
  const InstrumentPlace place_;
  const std::function<std::unique_ptr<ByteLink>()> connect_;
  Clock& clock_;
  // Both or none; null once one was lost.
  std::unique_ptr<Connection> sync_;
  std::unique_ptr<Connection> async_;
  bool overlapped_ = false;
  bool locked_ = false;
  std::size_t payload_size_ = kLeastPayload;
  std::uint32_t next_number_ = kFirstNumber;
  std::uint32_t asked_ = kNoNumber;  // of the last message that was sent
  std::uint8_t delivered_ = 0;       // 1: an answer was taken since the last message
  ByteString come_;                  // of a message that is not whole yet
  std::size_t size_ = 0;             // its bytes so far, with those beyond what is wanted
};

}  // namespace

std::unique_ptr<MessageLink> open_hislip_on(const std::string& address,
                                            const InstrumentPlace& place,
                                            std::function<std::unique_ptr<ByteLink>()> connect,
                                            Clock& clock) {
  return std::make_unique<HislipLink>(address, place, std::move(connect), clock);
}

std::unique_ptr<MessageLink> open_hislip(const std::string& place, Clock& clock) {
  const InstrumentPlace parsed = parse_instrument_place("hislip", place, "hislip0");
  const std::string where =
      join_host_and_port(parsed.host, parsed.port == 0 ? hislip::kPort : parsed.port);
  return open_hislip_on(
      "hislip:" + place, parsed,
      [where, &clock] { return open_tcp(where, kHislipPatience, clock); }, clock);
}

}  // namespace vitreo
