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
      device(std::move(its_device)) {}

}  // namespace vitreo
