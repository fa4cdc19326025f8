// Identity of an instrument as it reports it: asked for and checked when it is opened, and shown.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace vitreo {

struct Identity {
  std::string name;      ///< maker and model
  std::string serial;    ///< empty where the instrument does not report it
  std::string firmware;  ///< empty where the instrument does not report it
};

/// One line: "Zaber X-LSM050A, serial 12345, firmware 7.14".
inline std::string to_string(const Identity& identity) {
  std::string text = identity.name;
  if (!identity.serial.empty()) text += ", serial " + identity.serial;
  if (!identity.firmware.empty()) text += ", firmware " + identity.firmware;
  return text;
}

}  // namespace vitreo
