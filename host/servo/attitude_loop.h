// Attitude loop: the part of a servo loop that turns the robot's axis along a reference and makes
// good what the measured axis shows the field to be off.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/attitude_law.h"
#include "control/direction_path.h"
#include "devices/time/clock.h"
#include "host/record/recorder.h"
#include "host/servo/localizer.h"

#include <Eigen/Core>

#include <optional>

namespace vitreo {

/// Rests until the first turn(): then the loop's axis is a constant, as it was set.
class AttitudeLoop {
 public:
  /// `axis`: unit, world, the loop's own until a turn.
  AttitudeLoop(Recorder& recorder, const Eigen::Vector3d& axis,
               const control::AttitudeGains& gains);
  bool active() const { return active_; }
  /// From the next begin() on.
  void turn(const control::DirectionPath& path);
  /// A reference that was given begins at `now`, s.
  void begin(double now);
  /// Unit; the reference at a time, s.
  Eigen::Vector3d wanted(double time) const;
  const Eigen::Vector3d& goal() const { return path_.last(); }
  bool turned(double time) const;  // the reference has come to its end
  /// What a frame showed, and one row of the record, where it is active.
  void observe(Time exposed, const Observation& observation);
  /// Unit: the direction of the field for the axis wanted at a time, s.
  Eigen::Vector3d field_direction(double time) const;
  /// As last measured; nothing where the axis is not, or was not in the last frame.
  const std::optional<Eigen::Vector3d>& measured() const { return measured_; }

 private:
  void record(Time exposed, const Eigen::Vector3d& wanted);

  Recorder& recorder_;
  bool active_ = false;
  bool starting_ = false;
  control::DirectionPath path_;
  double begin_ = 0;  // s
  control::AttitudeLaw law_;
  bool either_end_;
  std::optional<Eigen::Vector3d> measured_;
  double sigma_ = 0;            // rad, of measured_
  std::optional<double> last_;  // s, of a measurement
  int stream_ = -1;
};

}  // namespace vitreo
