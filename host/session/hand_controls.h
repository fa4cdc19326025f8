// Hand controls: what a person may adjust of a run's instruments while it goes on.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>

#include <string>

namespace vitreo {

/// Any thread. What carries it out is in a room above the session (host/view/instrument_panel.h).
class HandControls {
 public:
  virtual ~HandControls() = default;
  /// Asks for `value`, SI, of the quantity `name`, by the hand of `by`. Throws
  /// std::invalid_argument for no such quantity, a value out of range, a run that is ending.
  virtual void adjust(const std::string& name, double value, const std::string& by) = 0;
  /// Asks that all are read anew. Throws std::invalid_argument as adjust() does.
  virtual void read() = 0;
  /// [{"name", "unit", "min", "max", "step", "value", "busy", "by", "refused"}]; null where a value
  /// is not known or an end is infinite.
  virtual nlohmann::json status() const = 0;
  virtual unsigned long changes() const noexcept = 0;
};

}  // namespace vitreo
