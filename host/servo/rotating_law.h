// Settings and state of the law "rotating": the field turns or oscillates, and the robot swims,
// rolls or tumbles.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/rotating_field.h"
#include "control/speed_curve.h"
#include "control/step_out.h"

#include <optional>

namespace vitreo {

struct RotatingSettings {
  control::RotatingMode mode = control::RotatingMode::helix;
  /// Hz, the fastest. Nothing: seven tenths of the believed step-out, within what the coils can do.
  std::optional<double> frequency{};
  std::optional<double> proportional{};  // 1/s; nothing: tuned
  std::optional<double> max_speed{};     // m/s, of the feedback alone; nothing: tuned
  bool recover = true;                   // at a step-out, go below it; else only tell
  // Of the mode oscillating:
  double swing = 0.7;                           // rad, of the field to either side
  std::optional<control::SpeedCurve> speeds{};  // measured; nothing: it can be spun, not steered
  void check() const;                           // throws std::invalid_argument naming the setting
};

/// What the field does and how the robot answers.
struct RotationState {
  control::Rotation rotation;          // as commanded
  control::RotationResponse response;  // of the robot to it
  double limit = 0;                    // Hz, the fastest now
  double believed_step_out = 0;        // Hz, by the model; 0: a tail, which has none
  double set_points = 0;               // 1/s
  bool unresponsive = false;           // moves less than it is driven, at any frequency
  bool standing = false;               // is steered, and seen in one place
};

}  // namespace vitreo
