// Rescue as data: the messages that bring an output to zero, for an instrument whose driver is no
// part of the program. Plain bytes, so that the guardian can send them without that driver.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/rescue.h"
#include "devices/links/serial_link.h"

#include <string>
#include <utility>
#include <vector>

namespace vitreo {

struct ByteScript {
  SerialSettings line{};
  std::string question{};           ///< who it is; sets nothing
  std::string identity{};           ///< what the answer to it holds
  std::vector<std::string> zero{};  ///< whole messages, in order
  /// Questions afterwards, and what each answer holds.
  std::vector<std::pair<std::string, std::string>> check{};
  bool operator==(const ByteScript& other) const;
};

/// In hexadecimal digits, without blanks or control characters; for a packet to the guardian.
std::string to_text(const ByteScript& script);
/// Throws std::invalid_argument for another text.
ByteScript parse_byte_script(const std::string& text);

/// All messages are sent to every link before any answer is read; a link that says something else
/// gets them again, and DeviceError at last.
Rescue rescue_by(const ByteScript& script);

}  // namespace vitreo
