// The role of the line that lets the amplifiers work: a digital output that a heartbeat toggles,
// with a retriggerable one-shot and a safety relay behind it (docs/how-to/heartbeat_line.md).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace vitreo {

class EnableLine {
 public:
  virtual ~EnableLine() = default;
  virtual std::string identity() const = 0;
  /// At once. Throws DeviceError.
  virtual void set(bool high) = 0;
  virtual bool high() const = 0;  ///< as last set; low when it is opened
  virtual void make_safe() = 0;   ///< low. Idempotent.
};

}  // namespace vitreo
