// SPDX-License-Identifier: Apache-2.0
#include "devices/links/onc_rpc.h"

#include "devices/time/error.h"

#include <algorithm>
#include <stdexcept>

namespace vitreo {
namespace {

constexpr std::uint32_t kCall = 0;
constexpr std::uint32_t kReply = 1;
constexpr std::uint32_t kRpcVersion = 2;
constexpr std::uint32_t kLastFragment = 0x80000000;
/// Far above the largest read that is asked for.
constexpr std::size_t kLargestReply = std::size_t{4} << 20;
constexpr std::size_t kAtOnce = 65536;

std::uint32_t word_of(std::span<const std::uint8_t> bytes) {
  return std::uint32_t{bytes[0]} << 24 | std::uint32_t{bytes[1]} << 16 |
         std::uint32_t{bytes[2]} << 8 | bytes[3];
}
constexpr std::size_t padded(std::size_t size) { return (size + 3) / 4 * 4; }

/// Neither says who it is (RFC 5531, AUTH_NONE): flavor 0, no bytes.
void put_no_authority(XdrWriter& writer) { writer.word(0).word(0); }

}  // namespace

XdrWriter& XdrWriter::word(std::uint32_t value) {
  for (const int shift : {24, 16, 8, 0})
    bytes_.push_back(static_cast<std::uint8_t>(value >> shift & 0xFF));
  return *this;
}
XdrWriter& XdrWriter::opaque(std::span<const std::uint8_t> bytes) {
  word(static_cast<std::uint32_t>(bytes.size()));
  bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
  bytes_.resize(padded(bytes_.size()));
  return *this;
}
XdrWriter& XdrWriter::text(std::string_view text) {
  return opaque({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
}

std::span<const std::uint8_t> XdrReader::take(std::size_t count) {
  if (count > left_.size()) throw std::out_of_range("too short");
  const auto taken = left_.first(count);
  left_ = left_.subspan(count);
  return taken;
}
std::uint32_t XdrReader::word() { return word_of(take(4)); }
ByteString XdrReader::opaque() {
  const std::size_t size = word();
  const auto bytes = take(size);
  take(padded(size) - size);
  return {bytes.begin(), bytes.end()};
}

namespace onc_rpc {

ByteString record(std::span<const std::uint8_t> message) {
  XdrWriter writer;
  writer.word(kLastFragment | static_cast<std::uint32_t>(message.size()));
  ByteString bytes = writer.bytes();
  bytes.insert(bytes.end(), message.begin(), message.end());
  return bytes;
}

std::optional<ByteString> take_record(ByteString& stream, std::size_t most) {
  ByteString message;
  for (std::size_t at = 0; at + 4 <= stream.size();) {
    const std::uint32_t head = word_of(std::span(stream).subspan(at, 4));
    const std::size_t size = head & ~kLastFragment;
    if (message.size() + size > most) throw std::length_error("a record without an end");
    at += 4;
    if (stream.size() - at < size) return std::nullopt;
    const auto begin = stream.begin() + static_cast<std::ptrdiff_t>(at);
    message.insert(message.end(), begin, begin + static_cast<std::ptrdiff_t>(size));
    at += size;
    if ((head & kLastFragment) == 0) continue;
    stream.erase(stream.begin(), stream.begin() + static_cast<std::ptrdiff_t>(at));
    return message;
  }
  return std::nullopt;
}

ByteString call(const Call& call, std::span<const std::uint8_t> arguments) {
  XdrWriter writer;
  writer.word(call.id).word(kCall).word(kRpcVersion);
  writer.word(call.program).word(call.version).word(call.procedure);
  put_no_authority(writer);
  put_no_authority(writer);
  ByteString message = writer.bytes();
  message.insert(message.end(), arguments.begin(), arguments.end());
  return message;
}

Call parse_call(XdrReader& reader) {
  Call call;
  call.id = reader.word();
  if (reader.word() != kCall || reader.word() != kRpcVersion) throw std::out_of_range("no call");
  call.program = reader.word();
  call.version = reader.word();
  call.procedure = reader.word();
  for (int i = 0; i < 2; ++i) {  // credentials and verifier
    reader.word();
    reader.opaque();
  }
  return call;
}

// Accepted, no verifier, success.
ByteString success(std::uint32_t id, std::span<const std::uint8_t> results) {
  XdrWriter writer;
  writer.word(id).word(kReply).word(0);
  put_no_authority(writer);
  writer.word(0);
  ByteString message = writer.bytes();
  message.insert(message.end(), results.begin(), results.end());
  return message;
}

}  // namespace onc_rpc

void OncRpc::fail(const char* what) const {
  throw DeviceError(DeviceErrorKind::protocol, link_.address(),
                    std::string("a reply that is none of a remote procedure call: ") + what);
}

std::uint32_t OncRpc::send(std::uint32_t procedure, const XdrWriter& arguments, Time timeout) {
  link_.write(
      onc_rpc::record(onc_rpc::call({++last_, program_, version_, procedure}, arguments.bytes())),
      timeout);
  return last_;
}

std::optional<ByteString> OncRpc::results(std::uint32_t id, Time deadline) {
  for (;;) {
    try {
      while (const auto reply = onc_rpc::take_record(stream_, kLargestReply))
        if (auto results = parse(*reply, id)) return results;
    } catch (const std::length_error& problem) {
      fail(problem.what());
    } catch (const std::out_of_range& problem) {
      fail(problem.what());
    }
    const Time left = std::max(deadline - clock_.now(), Time::zero());
    const ByteString come = link_.read(kAtOnce, left);
    if (come.empty()) return std::nullopt;
    stream_.insert(stream_.end(), come.begin(), come.end());
  }
}

/// RFC 5531, chapter 9. Nothing of a reply to another call.
std::optional<ByteString> OncRpc::parse(std::span<const std::uint8_t> reply,
                                        std::uint32_t id) const {
  const auto refuse = [this](const std::string& what) {
    throw DeviceError(DeviceErrorKind::refused, link_.address(), what);
  };
  XdrReader reader(reply);
  const std::uint32_t answered = reader.word();
  if (reader.word() != kReply) fail("not a reply");
  if (answered != id) return std::nullopt;
  if (reader.word() != 0) refuse("it denies remote procedure calls");
  reader.word();
  const std::size_t verifier = reader.opaque().size();
  switch (reader.word()) {
    case 0: {
      const std::size_t head = 24 + padded(verifier);
      return ByteString(reply.begin() + static_cast<std::ptrdiff_t>(head), reply.end());
    }
    case 1:
      refuse("it does not have this program, " + std::to_string(program_));
      break;
    case 2:
      refuse("it has another version of the program " + std::to_string(program_));
      break;
    case 3:
      refuse("it does not have this procedure of the program " + std::to_string(program_));
      break;
    case 4:
      fail("it did not understand the arguments");
    default:
      fail("its own error");
  }
  return std::nullopt;
}

}  // namespace vitreo
