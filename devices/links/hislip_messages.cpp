// SPDX-License-Identifier: Apache-2.0
#include "devices/links/hislip_messages.h"

#include "devices/time/error.h"

#include <algorithm>
#include <stdexcept>

namespace vitreo::hislip {
namespace {

constexpr std::size_t kAtOnce = 65536;

void put_big_endian(ByteString& bytes, std::uint64_t value, int size) {
  for (int shift = 8 * (size - 1); shift >= 0; shift -= 8)
    bytes.push_back(static_cast<std::uint8_t>(value >> shift & 0xFF));
}
std::uint64_t big_endian(std::span<const std::uint8_t> bytes) {
  std::uint64_t value = 0;
  for (const std::uint8_t byte : bytes) value = value << 8 | byte;
  return value;
}

}  // namespace

// Prologue "HS", type, control code, parameter, length of the payload: table 3.
ByteString to_bytes(const Message& message) {
  ByteString bytes{'H', 'S', static_cast<std::uint8_t>(message.type), message.control};
  put_big_endian(bytes, message.parameter, 4);
  put_big_endian(bytes, message.payload.size(), 8);
  bytes.insert(bytes.end(), message.payload.begin(), message.payload.end());
  return bytes;
}

std::optional<Message> take_message(ByteString& stream) {
  constexpr std::uint8_t kPrologue[] = {'H', 'S'};
  if (!std::equal(
          stream.begin(),
          stream.begin() + static_cast<std::ptrdiff_t>(std::min<std::size_t>(2, stream.size())),
          kPrologue))
    throw std::invalid_argument("it does not begin with HS");
  if (stream.size() < kHeader) return std::nullopt;
  const std::span<const std::uint8_t> head(stream);
  const std::uint64_t size = big_endian(head.subspan(8, 8));
  if (size > kLargestPayload) throw std::invalid_argument("its payload is too large");
  if (stream.size() - kHeader < size) return std::nullopt;
  Message message{static_cast<Type>(head[2]), head[3],
                  static_cast<std::uint32_t>(big_endian(head.subspan(4, 4)))};
  const auto begin = stream.begin() + kHeader;
  const auto end = begin + static_cast<std::ptrdiff_t>(size);
  message.payload.assign(begin, end);
  stream.erase(stream.begin(), end);
  return message;
}

ByteString size_payload(std::uint64_t size) {
  ByteString bytes;
  put_big_endian(bytes, size, 8);
  return bytes;
}
std::uint64_t size_in(std::span<const std::uint8_t> payload) {
  return big_endian(payload.first(std::min<std::size_t>(8, payload.size())));
}

std::optional<Message> Channel::receive(Time deadline) {
  for (;;) {
    try {
      if (auto message = take_message(stream_)) return message;
    } catch (const std::invalid_argument& problem) {
      throw DeviceError(DeviceErrorKind::protocol, link_.address(),
                        std::string("what came is no message of HiSLIP: ") + problem.what());
    }
    const Time left = std::max(deadline - clock_.now(), Time::zero());
    const ByteString come = link_.read(kAtOnce, left);
    if (come.empty()) return std::nullopt;
    stream_.insert(stream_.end(), come.begin(), come.end());
  }
}

}  // namespace vitreo::hislip
