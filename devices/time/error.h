// DeviceError: the failure of a device, of one of a few kinds.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <stdexcept>
#include <string>

namespace vitreo {

/// Few kinds, each of which a protocol can act on.
enum class DeviceErrorKind {
  not_found,     ///< nothing there, or something else is
  timeout,       ///< no answer in time
  lost,          ///< it was there and is gone
  protocol,      ///< it answered nonsense
  refused,       ///< it said no, or what it was asked for cannot be now
  out_of_range,  ///< the caller asked for what lies beyond a stated limit: nothing was sent
};
const char* to_string(DeviceErrorKind kind);

class DeviceError : public std::runtime_error {
 public:
  DeviceError(DeviceErrorKind kind, std::string device, const std::string& what);
  const DeviceErrorKind kind;
  const std::string device;  ///< the role or address, as in the rig file
  /// `what` as given: without the device and the kind, for an error that is thrown again under
  /// another name or with more to say.
  const std::string text;
};

/// The same error under the name that its device has in the rig; a link's own name stays in front
/// of the text.
DeviceError renamed(const DeviceError& error, const std::string& device);

}  // namespace vitreo
