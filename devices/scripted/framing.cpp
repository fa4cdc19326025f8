// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/framing.h"

namespace vitreo::scripted {

std::string framed(const Framing& framing, const std::string& message, std::uint16_t transaction) {
  if (framing.kind == Framing::Kind::modbus) {
    const ByteString pdu(message.begin(), message.end());
    const ByteString whole = framing.modbus == modbus::Framing::tcp
                                 ? modbus::tcp_frame(transaction, framing.unit, pdu)
                                 : modbus::rtu_frame(framing.unit, pdu);
    return {whole.begin(), whole.end()};
  }
  std::string whole = message + checksum_of(framing.checksum, message);
  if (framing.kind == Framing::Kind::brackets && !framing.plain_send)
    return framing.start + whole + framing.stop;
  return whole + framing.send_end;
}

std::string framed_answer(const Framing& framing, const std::string& message) {
  std::string whole = message + checksum_of(framing.checksum, message);
  if (framing.kind == Framing::Kind::brackets) return framing.start + whole + framing.stop;
  return framing.kind == Framing::Kind::line ? whole + framing.receive_end : whole;
}

}  // namespace vitreo::scripted
