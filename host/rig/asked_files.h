// Instruments of one Lua file that can be recognized where only an address is known: those whose
// identity is a plain question, at the line settings that they declare.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/identification.h"
#include "devices/links/serial_link.h"

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace vitreo {

struct AskedFile {
  std::string name;  ///< of the driver
  SerialSettings line;
  std::vector<std::string> buses;
  PortQuestion question;  ///< its `recognize` is not used
  /// As PortQuestion::recognize. What its pattern does wrong recognizes nothing.
  std::function<std::optional<Recognized>(const std::vector<ByteString>& answers)> recognize;
};

/// The program's own files that have such a question, in the order of their names; without those
/// whose question another one of them would take for a command, and those with errors.
std::vector<std::shared_ptr<const AskedFile>> asked_files(const std::vector<std::string>& folders);

}  // namespace vitreo
