// The role of a lamp that can be dimmed.
// SPDX-License-Identifier: Apache-2.0
#pragma once

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
  virtual void make_safe() = 0;      ///< dark. Idempotent.
};

}  // namespace vitreo
