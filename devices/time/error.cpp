// SPDX-License-Identifier: Apache-2.0
#include "devices/time/error.h"

#include <utility>

namespace vitreo {

const char* to_string(DeviceErrorKind kind) {
  switch (kind) {
    case DeviceErrorKind::not_found:
      return "not found";
    case DeviceErrorKind::timeout:
      return "timeout";
    case DeviceErrorKind::lost:
      return "lost";
    case DeviceErrorKind::protocol:
      return "protocol";
    case DeviceErrorKind::refused:
      return "refused";
    case DeviceErrorKind::out_of_range:
      return "out of range";
  }
  return "unknown";
}

// "coils: no answer within 0.1 s (timeout)"
DeviceError::DeviceError(DeviceErrorKind its_kind, std::string its_device, const std::string& what)
    : std::runtime_error(its_device + ": " + what + " (" + to_string(its_kind) + ")"),
      kind(its_kind),
      device(std::move(its_device)),
      text(what) {}

// "coils: hid:09db:009c: is gone (lost)": the link's name goes in front, but not that of the role
// itself a second time.
DeviceError renamed(const DeviceError& error, const std::string& device) {
  return {error.kind, device,
          error.device == device ? error.text : error.device + ": " + error.text};
}

}  // namespace vitreo
