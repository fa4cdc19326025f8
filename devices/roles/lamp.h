// The role of a lamp that can be dimmed.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/enable_line.h"
#include "devices/roles/link_state.h"

#include <string>

namespace vitreo {

class Lamp {
 public:
  virtual ~Lamp() = default;
  virtual std::string identity() const = 0;
  /// `level` of the full current, 0 to 1, at once. Throws std::invalid_argument for anything else,
  /// DeviceError.
  virtual void set_level(double level) = 0;
  virtual double level() const = 0;  ///< as last set
  /// Whether it is still there: throws DeviceError where it does not answer. Opens nothing.
  virtual void ask() = 0;
  /// Without a question, at once: a light that is held is listened to between two of them.
  virtual LinkState link_state() const { return {}; }
  virtual void make_safe() = 0;  ///< dark. Idempotent.
  /// Line of its own for a heartbeat, which it leaves low; null where it has none. Lives as long as
  /// the lamp.
  virtual EnableLine* enable_line() { return nullptr; }
};

}  // namespace vitreo
