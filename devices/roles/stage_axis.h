// Axis of a stage: its travel and speed limits, and the check of targets against them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>
#include <vector>

namespace vitreo {

/// Of a linear axis in m and m/s, of a rotary one in rad and rad/s.
struct StageAxis {
  std::string name;
  double travel_min = 0;  ///< the narrower of the instrument's and the rig file's
  double travel_max = 0;  ///< likewise
  double max_speed = 0;   ///< likewise
  double speed = 0;       ///< the usual one, at most max_speed
  double resolution = 0;  ///< the instrument's step: how far a position may be off its target
};

/// A position for messages, in mm (of m) or degrees (of rad): "5 mm".
std::string position_text(double position, const std::string& unit);

/// The check of every stage before it moves. Throws std::invalid_argument for a wrong count, a
/// number that is not finite or a speed that is not positive; DeviceError{out_of_range} under the
/// name `device` for a target outside the travel or a speed above the limit of an axis. `unit` is
/// that of positions, for messages.
void check_motion(const std::vector<StageAxis>& axes, std::span<const double> target, double speed,
                  const std::string& device, const char* unit);

}  // namespace vitreo
