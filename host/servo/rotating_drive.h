// Rotating drive: the part of a servo loop that turns the field, from a frame's position to the
// set-points between the frames, with its record, events and alarms.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"
#include "host/record/recorder.h"
#include "host/rig/rig.h"
#include "host/servo/field_rotor.h"
#include "host/servo/rotating_controller.h"

#include <optional>

namespace vitreo {

class RotatingDrive {
 public:
  /// Throws as RotatingController. The rig's coils are energized by the rotor's task alone.
  RotatingDrive(Clock& clock, Rig& rig, Recorder& recorder,
                const RotatingControllerSettings& settings);
  /// One turn of the loop: the currents of the result are those that flow by the last set-point.
  /// `path` is put off where the robot cannot follow it. `exposed`: of the frame. Throws what ended
  /// the rotor.
  ControlStep step(double now, const std::optional<control::PositionMeasurement>& measured,
                   ReferencePath& path, ControlMode mode, Time exposed);
  /// The robot was let go: no more set-points.
  void stop();
  void spin(const Eigen::Vector3d& axis, double frequency);
  void steer() { controller_.steer(); }
  void keep_out(const RobotClearance* clearance) { controller_.keep_out(clearance); }
  const RotationState& state() const { return controller_.state(); }
  /// Whether the robot's long axis is that of the rotation.
  bool shows_axis() const {
    return rig_.model.robot.helix.has_value() || rig_.model.robot.tail.has_value();
  }

 private:
  void report(const RotatingStep& step);
  void record(Time now);

  Clock& clock_;
  Rig& rig_;
  Recorder& recorder_;
  RotatingController controller_;
  FieldRotor rotor_;
  int stream_;
  bool was_unresponsive_ = false;
};

}  // namespace vitreo
