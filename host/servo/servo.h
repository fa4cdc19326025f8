// The servo loop: frame -> ellipse -> position -> velocity wanted -> field and force -> currents,
// once a frame, in C++. A script starts it, steers it, listens to it. Nothing in here can reach the
// simulator's truth, but for one role that must be asked for by name: the pose sensor.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/trajectory.h"
#include "devices/time/clock.h"
#include "host/record/recorder.h"
#include "host/rig/rig.h"
#include "host/servo/observers.h"
#include "host/servo/servo_controller.h"
#include "vision/background.h"

#include <Eigen/Core>

#include <exception>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace vitreo {

/// What tells the loop where the robot is (thesis 6.1). none: the top camera, as an operator's eye,
/// only while a place is to be reached; a robot that is released has the constant currents of the
/// place where the trim was found. pose_sensor: the simulator's truth, late and noisy; only a
/// simulated rig has one.
enum class Feedback { none, one_camera, two_cameras, pose_sensor };
const char* to_string(Feedback feedback);
/// Throws std::invalid_argument with the names there are.
Feedback feedback_named(const std::string& name);

/// What a calibration on the known retina (thesis 6.2) changed of the rig's view.
struct ViewCorrection {
  double image_scale = 1;           // of the aerial image's m per pixel
  Eigen::Vector3d offset{0, 0, 0};  // m, added to the place found
};

struct ServoSettings {
  double field = 10e-3;           // T, magnitude of the field
  Eigen::Vector3d axis{1, 0, 0};  // the robot's axis wanted, world
  Feedback feedback = Feedback::one_camera;
  ControlLaw law = ControlLaw::pd;
  control::PdGains gains;  // of the law pd
  std::optional<double> proportional{},
      max_speed{};                  // 1/s, m/s; of the law estimator; nothing: tuned
  control::VelocityGains velocity;  // of the law velocity
  std::vector<int> dead_coils;      // channels from 1, besides the rig's own
  double lost_timeout =
      1.0;  // s without a measurement before the loop lets go: zero current until told again
  std::optional<double>
      axis_sigma{};  // rad: how surely the robot lies along the field that is asked for; 0: surely,
                     // as in the thesis. Nothing: 0, but of the law estimator kAxisSigma
  bool wall_drag = false;  // ControllerSettings
  bool by_pose =
      false;  // a dry run: the pose sensor looks in the camera's place, whatever the feedback
  double axis_uncertainty() const;  // rad, as chosen or as the law has it
  void check() const;               // throws std::invalid_argument naming the setting
  ViewCorrection view;              // of the rig's own view
};

enum class ServoState { searching, holding, following, released, lost, failed, closed };
const char* to_string(ServoState state);

struct ServoStatus {
  ServoState state = ServoState::searching;
  Time time{};                              // exposure of the frame behind it
  std::optional<Eigen::Vector3d> position;  // m, world: measured
  std::optional<Eigen::Vector3d>
      disturbance;                  // m/s: what the model does not know of; law estimator only
  Eigen::Vector3d target{0, 0, 0};  // m, world: the reference at `time`
  double progress = 1;              // of the path that is being followed, 0 to 1
  double headroom = 1;              // 1 - largest |current| / limit, over the living coils
  bool limited = false;             // a current limit cost something of field or force
  std::string failure;              // what ended it, in state failed
  std::exception_ptr error;         // the same as it was thrown
};

/// What the loop may look through, besides the rig: learnt by Session::learn_background.
struct ServoCameras {
  std::optional<vision::Background> top;  // of the empty scene; not for the pose sensor
  SideWatch* side = nullptr;              // for two cameras
};

/// The calls return at once; `changed()` is notified at each tick. The loop runs as a task of the
/// clock; destruction ends it with the coils at zero.
class Servo {
 public:
  /// Throws std::invalid_argument naming the setting, or the role or view that the feedback needs
  /// and that is not there.
  Servo(Clock& clock, Rig& rig, Recorder& recorder, ServoCameras eyes,
        const ServoSettings& settings);
  ~Servo();
  ServoStatus status() const;
  Signal& changed();
  const ServoSettings& settings() const;
  /// Goes along a trajectory, then holds its end. Its time starts at the next tick. `pictures`: so
  /// many snapshots evenly along the way. Throws std::invalid_argument for a place out of reach,
  /// and then goes on as before.
  void follow(const control::Trajectory& path, int pictures = 0);
  void hold(const Eigen::Vector3d& position);  // throws as follow
  /// The field still follows the robot and carries its weight (feedback none: the currents stay
  /// constant); its place is left alone. `cancel`: but for what the estimator knows to push it.
  /// Throws std::invalid_argument for another law.
  void release(bool cancel = false);
  /// The constant force that is added to the weight compensation (the thesis' hand trim), N, world.
  void set_trim(const Eigen::Vector3d& force);
  Eigen::Vector3d trim() const;
  /// The force that moves the robot at `velocity` through the medium, N.
  Eigen::Vector3d force_for(const Eigen::Vector3d& velocity) const;
  /// Mean over the last `duration` of the velocity the position controller asked for, turned into a
  /// force, N: what the model lacks at this place. Throws std::logic_error when it was not holding
  /// that long.
  Eigen::Vector3d mean_correction(double duration) const;
  /// Added to every place that the top camera finds (m, world): the localization's bias, as it was
  /// found at a known place. Throws std::invalid_argument for one that is not finite, or above 1
  /// mm.
  void set_offset(const Eigen::Vector3d& offset);
  Eigen::Vector3d offset() const;
  /// Puts the next frame, with the tracked ellipse, the trail and the target drawn on it, into the
  /// record.
  void snapshot(const std::string& caption);
  void close();  // zero current, ends the loop; idempotent

 private:
  struct Loop;
  std::unique_ptr<Loop> loop_;
};

/// Throws std::invalid_argument naming the place where the robot cannot be taken: outside the field
/// model's region, the retina or the lens.
void check_reach(const RigModel& model, const control::Trajectory& path);

}  // namespace vitreo
