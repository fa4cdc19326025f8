// Observation source of a servo loop: one frame of the top camera, with the side camera where it
// has one, or one reading of the pose sensor, and the robot's position in it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/camera.h"
#include "devices/time/clock.h"
#include "host/record/recorder.h"
#include "host/rig/rig.h"
#include "host/servo/believed_view.h"
#include "host/servo/frame_validator.h"
#include "host/servo/localizer.h"
#include "host/servo/observers.h"
#include "host/servo/servo_settings.h"
#include "host/servo/view_watch.h"

#include <optional>

namespace vitreo {

class ObservationSource {
 public:
  /// Throws std::invalid_argument naming the role or the view that the feedback needs and that is
  /// not there.
  ObservationSource(Clock& clock, Rig& rig, Recorder& recorder, ServoCameras cameras,
                    const ServoSettings& settings);

  struct ObservedFrame {
    Frame frame;  // of the pose sensor: without an image
    /// Its position in the world, m; in a dry run with the ellipse that an image would have shown.
    Observation observation;
    std::string distrusted{};  // why the picture is not believed; it is then without a position
  };
  /// Waits for the next one that is plausible. Throws DeviceError as the devices do, and
  /// {protocol} for what does not change (FrameValidator).
  ObservedFrame next();
  double period() const;  // s, between frames
  /// Added to what the top camera finds; m, world.
  void set_offset(const Eigen::Vector3d& offset) { offset_ = offset; }
  const Eigen::Vector3d& offset() const { return offset_; }
  /// The robot's axis that the next frames are to show, unit, world.
  void expect_axis(const Eigen::Vector3d& axis);
  /// Events with the numbers of frames passed over, at the end.
  void report_counts() { validator_.report_count(); }

 private:
  std::optional<ObservedFrame> by_pose(Time patience);
  std::optional<ObservedFrame> by_camera(Time patience);
  void reject_implausible(Observation& observation);
  void reject_other_view(ObservedFrame& found, const cv::Mat& gray);

  Clock& clock_;
  Rig& rig_;
  Recorder& recorder_;
  const Feedback feedback_;
  const bool by_pose_;
  std::optional<Localizer> localizer_;     // of the feedbacks with a camera
  std::optional<BelievedView> rehearsed_;  // of the same in a dry run
  SideObservationBuffer* const side_;
  FrameValidator validator_;
  Eigen::Vector3d offset_{0, 0, 0};
  std::optional<ViewWatch> view_;  // of the feedbacks with a camera
  bool was_implausible_ = false;
  bool was_other_view_ = false;
};

}  // namespace vitreo
