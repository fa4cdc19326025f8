// Servo loop: frame -> ellipse -> position -> velocity wanted -> field and force -> currents, once
// a frame, in C++. A script starts it, steers it, listens to it. Nothing in here can reach the
// simulator's truth, but for one role that must be asked for by name: the pose sensor.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/clearance.h"
#include "control/direction_path.h"
#include "control/trajectory.h"
#include "devices/time/clock.h"
#include "host/record/recorder.h"
#include "host/rig/rig.h"
#include "host/servo/servo_settings.h"

#include <Eigen/Core>

#include <exception>
#include <memory>
#include <optional>
#include <string>
#include <utility>

namespace vitreo {
struct ServoCameras;

enum class ServoState { searching, holding, following, released, lost, failed, closed };
const char* to_string(ServoState state);

struct ServoStatus {
  ServoState state = ServoState::searching;
  Time time{};                              // exposure of the frame behind it
  std::optional<Eigen::Vector3d> position;  // m, world: measured
  /// m/s, the robot's velocity beyond the commanded one; law estimator only.
  std::optional<Eigen::Vector3d> disturbance;
  Eigen::Vector3d target{0, 0, 0};      // m, world: the reference at `time`
  Eigen::Vector3d direction{1, 0, 0};   // unit, world: the reference of the robot's axis
  std::optional<Eigen::Vector3d> axis;  // unit, world: measured
  bool turned = true;                   // the axis' reference has come to its end
  double progress = 1;                  // of the path that is being followed, 0 to 1
  double field = 0;                     // T, that is commanded
  double headroom = 1;                  // 1 - largest |current| / limit, over the living coils
  bool limited = false;                 // a current limit cost something of field or force
  /// Of the robot's surface; nothing while it is not seen, and without a lens in the rig's eye.
  std::optional<control::Clearance> clearance;
  bool kept_out = false;     // the keep-out margin changed the command
  std::string failure;       // what ended it, in state failed
  std::exception_ptr error;  // the same as it was thrown
};

/// The calls return at once; `changed()` is notified at each tick. The loop runs as a task of the
/// clock; destruction ends it with the coils at zero.
class Servo {
 public:
  /// Throws std::invalid_argument naming the setting, or the role or view that the feedback needs
  /// and that is not there.
  Servo(Clock& clock, Rig& rig, Recorder& recorder, ServoCameras cameras,
        const ServoSettings& settings);
  ~Servo();
  ServoStatus status() const;
  Signal& changed();
  const ServoSettings& settings() const;
  /// Goes along a trajectory, then holds its end. Its time starts at the next tick. `pictures`: so
  /// many snapshots evenly along the way. Throws std::invalid_argument for a position out of reach,
  /// or nearer to a wall than the keep-out margin, and then goes on as before.
  void follow(const control::Trajectory& path, int pictures = 0);
  /// Why follow() would refuse it now; empty: it would not.
  std::string refusal(const control::Trajectory& path) const;
  /// Holds a position from the next tick on. One that moves (m/s) goes on for kMovingHold s, and
  /// rests there unless it was said anew: a script that falls silent sends the robot nowhere.
  /// Throws as follow.
  void hold(const Eigen::Vector3d& position,
            const Eigen::Vector3d& velocity = Eigen::Vector3d::Zero());
  static constexpr double kMovingHold = 0.25;
  /// Turns the robot's axis along a reference, from the next tick on, whatever the position does.
  /// The rotation about the axis itself is not controlled: a moment along it has no torque there.
  /// Throws std::invalid_argument for the law rotating, whose axis is its means to go somewhere.
  void turn(const control::DirectionPath& path);
  /// The reference of the axis now, unit.
  Eigen::Vector3d direction() const;
  /// The field still follows the robot and carries its weight (feedback none: the currents stay
  /// constant); its position is left alone. `cancel`: but for the disturbance that the estimator
  /// knows, which is compensated. `touch`: until the next goal the keep-out margin is off, as for a
  /// robot that is to lie on the retina.
  /// Throws std::invalid_argument for another law.
  void release(bool cancel = false, bool touch = false);
  /// Law rotating: the field turns about `axis` (unit, world) at `frequency` (Hz; negative: the
  /// other way), wherever the robot goes, until the next goal. Throws std::invalid_argument for
  /// another law, or what is no direction.
  void spin(const Eigen::Vector3d& axis, double frequency);
  /// What the field does and how the robot answers; nothing for another law.
  std::optional<RotationState> rotation() const;
  /// The constant force that is added to the weight compensation (the thesis' hand trim), N, world.
  void set_trim(const Eigen::Vector3d& force);
  Eigen::Vector3d trim() const;
  /// The force that moves the robot at `velocity` through the medium, N.
  Eigen::Vector3d force_for(const Eigen::Vector3d& velocity) const;
  /// Mean over the last `duration` of the velocity the position controller asked for, turned into a
  /// force, N: what the model lacks at this position. Throws std::logic_error when it was not
  /// holding that long.
  Eigen::Vector3d mean_correction(double duration) const;
  /// Added to every position that the top camera finds (m, world): the localization's bias, as it
  /// was found at a known position. From the loop's next turn on. Throws std::invalid_argument for
  /// one that is not finite, or above 3 mm.
  void set_offset(const Eigen::Vector3d& offset);
  Eigen::Vector3d offset() const;
  /// Of the law estimator with the gains in use; nothing for other laws, and before it has
  /// measured.
  std::optional<ServoMargins> margins() const;
  double margin() const;  // m, that the robot's surface keeps from retina and lens
  /// Switches the coils off for `duration` (s), from the next turn on, and holds the robot again
  /// where it was to be: what it sinks meanwhile is weight over drag, of no field model. Throws
  /// std::invalid_argument for more than 1 s, std::logic_error for another law than the estimator.
  void let_fall(double duration);
  /// s, of the run's clock: the commands between which the robot fell last; nothing while it falls.
  std::optional<std::pair<double, double>> last_fall() const;
  /// What was wrong with the control since the last goal was given.
  LoopQuality quality() const;
  /// Puts the next frame, with the tracked ellipse, the trail and the target drawn on it, into the
  /// record.
  void snapshot(const std::string& caption);
  void close();  // zero current, ends the loop; idempotent

 private:
  struct Loop;
  std::unique_ptr<Loop> loop_;
};

}  // namespace vitreo
