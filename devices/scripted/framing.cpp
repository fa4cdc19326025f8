// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/framing.h"

#include "devices/links/byte_link.h"

namespace vitreo::scripted {

namespace {

std::string bracketed(const Framing& framing, const std::string& message,
                      const std::string& whole) {
  if (framing.counted < 0) return framing.start + whole + framing.stop;
  const std::size_t count = message.size() + static_cast<std::size_t>(framing.counted);
  if (count > 255)
    throw ScriptFault("a message of " + std::to_string(message.size()) +
                      " bytes is longer than its length byte can say");
  return framing.start + static_cast<char>(count) + whole + framing.stop;
}

}  // namespace

std::string framed(const Framing& framing, const std::string& message, std::uint16_t transaction) {
  if (framing.kind == Framing::Kind::modbus) {
    const ByteString pdu(message.begin(), message.end());
    const ByteString whole = framing.modbus == modbus::Framing::tcp
                                 ? modbus::tcp_frame(transaction, framing.unit, pdu)
                                 : modbus::rtu_frame(framing.unit, pdu);
    return {whole.begin(), whole.end()};
  }
  // The checksum covers the message alone: neither brackets nor the length byte.
  std::string whole = message + checksum_of(framing.checksum, message);
  if (framing.kind == Framing::Kind::brackets && !framing.plain_send)
    return bracketed(framing, message, whole);
  return whole + framing.send_end;
}

std::string framed_answer(const Framing& framing, const std::string& message) {
  std::string whole = message + checksum_of(framing.checksum, message);
  if (framing.kind == Framing::Kind::brackets) return bracketed(framing, message, whole);
  return framing.kind == Framing::Kind::line ? whole + framing.receive_end : whole;
}

}  // namespace vitreo::scripted
