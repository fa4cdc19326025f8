// Observation source of a servo loop: one frame of the top camera, with the side camera where it
// has one, or one reading of the pose sensor, and the robot's position in it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/camera.h"
#include "devices/time/clock.h"
#include "host/record/recorder.h"
#include "host/rig/rig.h"
#include "host/servo/believed_view.h"
#include "host/servo/eye_choice.h"
#include "host/servo/frame_validator.h"
#include "host/servo/localizer.h"
#include "host/servo/observers.h"
#include "host/servo/plant_gate.h"
#include "host/servo/servo_settings.h"
#include "host/servo/view_watch.h"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace vitreo {
struct ServoCameras;

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
  /// What the currents that act from `acts` (s) on make of the robot, m/s: for a loop whose eyes
  /// are held against it.
  void expect_motion(double acts, const Eigen::Vector3d& velocity);
  /// Whether expect_motion() is of use.
  bool gated() const { return gate_.has_value(); }
  /// Events with the numbers of frames passed over, at the end.
  void report_counts() { validator_.report_count(); }

 private:
  std::optional<ObservedFrame> by_pose(Time patience);
  std::optional<ObservedFrame> by_camera(Time patience);
  struct Eye {
    std::unique_ptr<Localizer> localizer;
    bool wants_ground;         // sees by a background that must be as it was learnt
    int refused = 0;           // by the gate, in a row
    bool was_refused = false;  // the event was said
    bool was_implausible = false;
    bool was_by_ellipse = false;
  };
  void report_fallback(Eye& eye, const Observation& observation);
  void join(ObservedFrame& found);
  void reject_contradicted(ObservedFrame& found);
  Observation look(Eye& eye, const Frame& frame, bool ground_fits);
  void reject_implausible(Eye& eye, Observation& observation);
  void reject_misplaced(Eye& eye, double time, Observation& observation);
  std::string other_view(const cv::Mat& picture);
  Observation chosen(std::vector<Observation> seen, double time);

  Clock& clock_;
  Rig& rig_;
  Recorder& recorder_;
  const Feedback feedback_;
  const bool by_pose_;
  std::vector<Eye> eyes_;  // of the feedbacks with a camera
  EyeChoice choice_;
  std::optional<std::size_t> eye_;         // that steers
  std::optional<PlantGate> gate_;          // of the feedbacks by color
  std::optional<BelievedView> rehearsed_;  // of the same in a dry run
  SideObservationBuffer* const side_;
  FrameValidator validator_;
  Eigen::Vector3d offset_{0, 0, 0};
  std::optional<ViewWatch> view_;  // of the feedbacks by a background
  bool was_other_view_ = false;
  bool was_contradicted_ = false;
  bool was_apart_ = false;
};

}  // namespace vitreo
