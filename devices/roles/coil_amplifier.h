// The role of the amplifiers that drive the coils.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/enable_line.h"
#include "devices/roles/link_state.h"

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace vitreo {

class CoilAmplifier {
 public:
  virtual ~CoilAmplifier() = default;
  virtual std::string identity() const = 0;
  virtual int channels() const = 0;
  virtual double current_limit() const = 0;  ///< A, per channel, either sign
  /// Sets all channels together, in A. Throws std::invalid_argument for a wrong count or a number
  /// that is not finite, DeviceError{refused} beyond the limit; then nothing has changed.
  virtual void set_currents(std::span<const double> currents) = 0;
  virtual std::vector<double> currents() const = 0;  ///< A, as last set
  /// A, one per channel, as the instrument itself measures them; nothing where it measures none.
  /// Asked in either case, so that a device that is gone shows: throws DeviceError.
  virtual std::optional<std::vector<double>> measured_currents() = 0;
  /// Without a question, at once: what is held is listened to between two of them.
  virtual LinkState link_state() const { return {}; }
  /// Zero current on every channel, whatever the state. Idempotent.
  virtual void make_safe() = 0;
  /// Line of its own for a heartbeat, which it leaves low; null where it has none. Lives as long as
  /// the amplifier.
  virtual EnableLine* enable_line() { return nullptr; }
};

}  // namespace vitreo
