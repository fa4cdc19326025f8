// ONC remote procedure calls over a stream, as far as VXI-11 wants them: XDR, record marking, one
// program on one connection. Sources: RFC 4506 (XDR), RFC 5531 (RPC), RFC 1833 (port mapper).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/time/clock.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string_view>

namespace vitreo {

/// Arguments: words of four bytes, big-endian; what is shorter is filled with zeros.
class XdrWriter {
 public:
  XdrWriter& word(std::uint32_t value);
  XdrWriter& opaque(std::span<const std::uint8_t> bytes);  ///< its length before it
  XdrWriter& text(std::string_view text);
  const ByteString& bytes() const { return bytes_; }

 private:
  ByteString bytes_;
};

/// Results. Throws std::out_of_range at their end.
class XdrReader {
 public:
  explicit XdrReader(std::span<const std::uint8_t> bytes) : left_(bytes) {}
  std::uint32_t word();
  ByteString opaque();

 private:
  std::span<const std::uint8_t> take(std::size_t count);
  std::span<const std::uint8_t> left_;
};

/// What the other side of VXI-11's links reads and writes; emulators use it too.
namespace onc_rpc {

/// A record of one fragment: RFC 5531, chapter 11.
ByteString record(std::span<const std::uint8_t> message);
/// The first record in `stream`, taken out of it; nothing while it is not whole. Throws
/// std::length_error for one of more than `most` bytes.
std::optional<ByteString> take_record(ByteString& stream, std::size_t most);

struct Call {
  std::uint32_t id = 0;
  std::uint32_t program = 0;
  std::uint32_t version = 0;
  std::uint32_t procedure = 0;
};
ByteString call(const Call& call, std::span<const std::uint8_t> arguments);
/// The call in a record and where its arguments begin. Throws std::out_of_range.
Call parse_call(XdrReader& reader);
/// Answer to a call that was carried out.
ByteString success(std::uint32_t id, std::span<const std::uint8_t> results);

}  // namespace onc_rpc

/// Calls on one connection. A reply is matched by its number: one that comes too late is dropped.
class OncRpc {
 public:
  /// `link` outlives it.
  OncRpc(ByteLink& link, Clock& clock, std::uint32_t program, std::uint32_t version)
      : link_(link), clock_(clock), program_(program), version_(version) {}
  /// Puts a call on its way; returns its number.
  std::uint32_t send(std::uint32_t procedure, const XdrWriter& arguments, Time timeout);
  /// The results of call number `id`, by `deadline`; nothing when none came: it may be asked again.
  /// Throws DeviceError{protocol} for what is no reply, {refused} where the other side does not
  /// know the call, {lost}, Stopped.
  std::optional<ByteString> results(std::uint32_t id, Time deadline);
  /// What has come of a reply is forgotten: the link was opened again.
  void forget() { stream_.clear(); }

 private:
  [[noreturn]] void fail(const char* what) const;
  std::optional<ByteString> parse(std::span<const std::uint8_t> reply, std::uint32_t id) const;

  ByteLink& link_;
  Clock& clock_;
  const std::uint32_t program_;
  const std::uint32_t version_;
  std::uint32_t last_ = 0;
  ByteString stream_;
};

}  // namespace vitreo
