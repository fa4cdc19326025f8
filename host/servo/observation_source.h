// What a servo loop sees: one frame of the top camera, with the side camera where it has one, or
// one reading of the pose sensor, and where the robot is in it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/camera.h"
#include "devices/time/clock.h"
#include "host/record/recorder.h"
#include "host/rig/rig.h"
#include "host/servo/frame_validator.h"
#include "host/servo/localizer.h"
#include "host/servo/servo.h"

#include <optional>

namespace vitreo {

class ObservationSource {
 public:
  /// Throws std::invalid_argument naming the role or the view that the feedback needs and that is
  /// not there.
  ObservationSource(Clock& clock, Rig& rig, Recorder& recorder, ServoCameras eyes,
                    const ServoSettings& settings);

  struct Look {
    Frame frame;              // without an image of the pose sensor's
    Observation observation;  // its position in the world, m
  };
  /// Waits for the next one that can be believed. Throws DeviceError as the devices do, and
  /// {protocol} for what does not change (FrameValidator).
  Look look();
  double period() const;  // s, between looks
  /// Added to what the top camera finds; m, world.
  void set_offset(const Eigen::Vector3d& offset) { offset_ = offset; }
  const Eigen::Vector3d& offset() const { return offset_; }
  /// For the record, at the end.
  void tell() { guard_.tell(); }

 private:
  std::optional<Look> by_pose(Time patience);
  std::optional<Look> by_camera(Time patience);
  void refuse_strangers(Observation& observation);

  Clock& clock_;
  Rig& rig_;
  Recorder& recorder_;
  const Feedback feedback_;
  const bool by_pose_;
  std::optional<Localizer> localizer_;  // of the feedbacks that look
  SideWatch* const side_;
  FrameValidator guard_;
  Eigen::Vector3d offset_{0, 0, 0};
  bool was_strange_ = false;
};

}  // namespace vitreo
