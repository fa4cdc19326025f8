// Framing of messages on a link: where one ends and the next begins.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/modbus_frames.h"
#include "devices/scripted/checksum.h"
#include "devices/scripted/sandbox.h"
#include "devices/time/clock.h"

#include <cstddef>
#include <cstdint>
#include <string>

namespace vitreo::scripted {

/// Where one message ends and the next begins.
struct Framing {
  enum class Kind { line, fixed, header, brackets, quiet, modbus };
  Kind kind = Kind::line;
  bool plain_send = false;  ///< what is sent ends with send_end, whatever the answers are framed by
  std::string send_end = "\n";     ///< of lines
  std::string receive_end = "\n";  ///< of lines
  std::size_t length = 0;          ///< of a fixed message, or of a header, bytes
  Reference rest{};                ///< function(header): how many bytes follow it
  std::string start{}, stop{};     ///< of brackets, one byte each
  /// Of brackets: the byte behind `start` is the text's length plus this; negative: there is none.
  int counted = -1;
  Time quiet{};  ///< silence that ends a message
  modbus::Framing modbus = modbus::Framing::rtu;
  std::uint8_t unit = 1;  ///< of Modbus; a message is a PDU there: function and data
  Checksum checksum = Checksum::none;
  std::size_t most = 4096;  ///< bytes of a message
};

/// A message as it is sent, and as the instrument sends it: with checksum and frame. `transaction`
/// is of Modbus on TCP.
std::string framed(const Framing& framing, const std::string& message,
                   std::uint16_t transaction = 0);
std::string framed_answer(const Framing& framing, const std::string& message);

}  // namespace vitreo::scripted
