// HiSLIP messages on one of its two channels (IVI-6.1, High-Speed LAN Instrument Protocol, 1.1):
// header and payload, whole, within a deadline.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/time/clock.h"

#include <cstdint>
#include <optional>
#include <span>

namespace vitreo::hislip {

constexpr int kPort = 4880;

/// Table 4.
enum class Type : std::uint8_t {
  initialize = 0,
  initialize_response = 1,
  fatal_error = 2,
  error = 3,
  async_lock = 4,
  async_lock_response = 5,
  data = 6,
  data_end = 7,
  device_clear_complete = 8,
  device_clear_acknowledge = 9,
  interrupted = 13,
  async_interrupted = 14,
  async_maximum_message_size = 15,
  async_maximum_message_size_response = 16,
  async_initialize = 17,
  async_initialize_response = 18,
  async_device_clear = 19,
  async_service_request = 20,
  async_device_clear_acknowledge = 23,
};

struct Message {
  Type type = Type::data;
  std::uint8_t control = 0;
  std::uint32_t parameter = 0;
  ByteString payload{};
};

constexpr std::size_t kHeader = 16;
/// Of a payload: what is more is no message of this protocol's, or none for us.
constexpr std::uint64_t kLargestPayload = std::uint64_t{16} << 20;

ByteString to_bytes(const Message& message);
/// The first message in `stream`, taken out of it; nothing while it is not whole. Throws
/// std::invalid_argument for what begins no message, and for a payload that is too large.
std::optional<Message> take_message(ByteString& stream);

/// Eight bytes, big-endian: the payload that carries a size.
ByteString size_payload(std::uint64_t size);
std::uint64_t size_in(std::span<const std::uint8_t> payload);

/// One of the two connections.
class Channel {
 public:
  /// `link` outlives it.
  Channel(ByteLink& link, Clock& clock) : link_(link), clock_(clock) {}
  void send(const Message& message, Time timeout) { link_.write(to_bytes(message), timeout); }
  /// The next message, by `deadline`; nothing when none was whole by then: what came is kept.
  /// Throws DeviceError{protocol} for what is none, {lost}, Stopped.
  std::optional<Message> receive(Time deadline);

 private:
  ByteLink& link_;
  Clock& clock_;
  ByteString stream_;
};

}  // namespace vitreo::hislip
