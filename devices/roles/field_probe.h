// The role of a field probe: a teslameter with one axis or three.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"
#include "devices/time/identity.h"

#include <vector>

namespace vitreo {

struct FieldProbeInfo {
  Identity identity;
  int axes = 1;      ///< 1 or 3
  double range = 0;  ///< T: the largest magnitude of a component that it can measure
};

struct FieldReading {
  std::vector<double> field;  ///< T, one per axis, along the probe's own axes
  Time measured{};            ///< the moment of whose field it is
  Time within{};              ///< half the width of what is known of that moment
};

/// It has no outputs: there is nothing to make safe.
class FieldProbe {
 public:
  virtual ~FieldProbe() = default;
  virtual const FieldProbeInfo& info() const = 0;
  /// A reading taken after the call. Throws DeviceError{timeout}, {refused} when the field is
  /// beyond the range, {lost}, {protocol}; Stopped.
  virtual FieldReading measure(Time timeout) = 0;
};

}  // namespace vitreo
