// State and task of a servo loop: one turn a frame, from the observation to currents, status and
// record. Of servo.h alone.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/safety/interlock.h"
#include "host/servo/attitude_loop.h"
#include "host/servo/loop_report.h"
#include "host/servo/observation_source.h"
#include "host/servo/paired_view.h"
#include "host/servo/plant_watch.h"
#include "host/servo/robot_clearance.h"
#include "host/servo/rotating_drive.h"
#include "host/servo/servo.h"
#include "host/servo/servo_cameras.h"
#include "host/servo/servo_controller.h"
#include "host/servo/servo_record.h"
#include "host/servo/wall_watch.h"

#include <Eigen/Core>

#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <utility>

namespace vitreo {

/// All of the loop's state. Its task and the script's calls hold the clock's one baton in turn,
/// which changes hands only where one of them waits, so no lock is needed.
struct Servo::Loop {
  enum class Mode { holding, following, released, falling };
  /// Source and controller check their own settings and throw naming them.
  Loop(Clock& the_clock, Rig& the_rig, Recorder& the_recorder, ServoCameras given_cameras,
       const ServoSettings& given);
  /// The loop's task: a turn for each frame until it is stopped or something fails.
  /// A stop of the loop sets the coils to zero; any other end makes the interlock open (shut()).
  /// Nothing leaves this function, as it is a task's body.
  void run();
  /// The next frame that was exposed since the loop was made.
  ObservationSource::ObservedFrame next();
  /// One turn: measurement, control, publication, record.
  /// The record comes after the currents, so that writing never delays them.
  void tick();
  /// A path that was given between two frames begins with the next one.
  void begin(double now);
  /// What the next frame will show of the robot's axis; it is exposed a period after the last one.
  void expect_axis();
  /// A fall begins and ends with a turn: the times are those of its commands.
  void begin_fall(double now);
  /// Seen means used: the dead-man is refreshed only while what moves the robot is steered by
  /// measurements that the controller took, or there is nothing that moves it yet, or any more.
  void beat();
  /// Better let it sink than drive it blind.
  void let_the_robot_go(const std::string& why);
  /// When a measurement was last taken, and what follows when that is too long ago; by the run's
  /// clock, as a stamp may be wrong. A robot that was let go counts as seen where it is seen.
  void note_taken(const Observation& observation, const ControlStep& step,
                  const std::string& distrusted);
  void take_offset();
  /// Amplifiers and coils, by what the robot does. Not by the laws for media that the model does
  /// not know, nor beside a wall, where contact holds the robot.
  bool beside_a_wall(const control::WallClearance& wall) const;
  void watch_plant(const Frame& frame, double now, const Observation& observation,
                   const ControlStep& step);
  void look_at_walls(const Observation& observation);
  void show_clearance();  // of `nearness`
  /// Alarms: inside the margin, and pushed against a wall that the position does not show. In that
  /// case the view is wrong by what it shows there, and is believed so from then on.
  void doubt_nearness(const control::PositionEstimate& estimate);
  void watch_walls(const Frame& frame, const control::Reference& target, const ControlStep& step);
  /// What the interlock judges by: the speed at which these currents alone drive the robot towards
  /// the nearest wall, by the model.
  void report_nearness(const control::Currents& currents);
  /// What helps where a limit cuts: a soft robot's moment grows with its field.
  std::string advice() const;
  /// The measurement keeps the time of its exposure; what became of the robot since then is the
  /// law's to predict.
  ControlStep drive(const Frame& frame, double now, const Observation& observation);
  /// Released, the field follows the robot, except where no camera is in the loop: then the
  /// currents stay as they are (thesis 6.1, case a).
  ControlMode control_mode() const;
  void send(const control::Currents& wanted);
  /// Where these currents take the robot, by the model, weight included.
  void expect_motion(const control::Currents& currents);
  void switch_off();
  /// For mean_correction(): a sliding window of the velocities asked for.
  void remember(double time, const Eigen::Vector3d& correction);
  /// "searching" and "lost" outrank the mode: no path is being followed that cannot be seen.
  void publish(const Frame& frame, const control::Reference& target, const Observation& observation,
               const ControlStep& step);
  void check_goal(const control::Trajectory& path) const;  // throws as Servo::follow
  /// Checked before anything is changed, so a path that is refused leaves the loop as it was.
  void set_goal(Mode wanted, const control::Trajectory& path, int wanted_pictures);
  /// A robot that is laid on the retina on purpose; the record says so.
  void allow_touch(bool allowed);
  /// Of the law in use; the other has no say.
  void keep_out(bool keeps);
  /// The end of the loop: zero current, and the interlock open after a failure until it is enabled
  /// again. A failure of that does not hide the first one.
  void shut(ServoState state, const std::string& failure);
  Clock& clock;
  Rig& rig;
  Recorder& recorder;
  const ServoSettings settings;
  const Time made_at;
  ObservationSource source;
  ServoController controller;
  ServoRecord archive;
  LoopReport reports;
  AttitudeLoop attitude;
  std::optional<RotatingDrive> rotating;          // of that law, in the controller's place
  std::optional<Interlock::Heartbeat> heartbeat;  // while the loop runs
  Mode mode = Mode::holding;
  bool was_constant = false;  // the currents, a turn ago
  PairedView pairs;           // of what the plant watch hears
  ReferencePath reference;
  Eigen::Vector3d goal{0, 0, 0};    // m, the end of the reference
  bool starting = false;            // the reference's time has not begun
  Eigen::Vector3d offset{0, 0, 0};  // m: the view's correction, from the next turn on
  bool seen = false;                // once at least
  bool let_go = false;              // lost for longer than the timeout: zero current
  bool canceling = false;           // of mode released
  RobotClearance surface;
  PlantWatch plant;
  WallWatch walls;
  std::optional<PlacedClearance> nearness;  // of this frame: status.clearance, and where
  bool may_touch = false;
  bool was_inside = false;
  struct {
    double duration = 0;  // s
    double off = 0;       // s, of the command
    double on = 0;        // s, of the first command after it
    bool begun = false;
    bool over = true;
  } fall;
  Time taken_at{};                             // when a measurement was last taken
  std::string not_taken;                       // why the last one was not
  std::optional<Eigen::Vector3d> expected_at;  // m, world: where the robot was seen last
  ServoStatus status;
  Signal ticked;
  std::deque<std::pair<double, Eigen::Vector3d>> corrections;  // s, m/s
  std::string wanted_picture;
  int pictures = 0;  // wanted along the path that is being followed
  int pictures_taken = 0;
  std::unique_ptr<Task> task;  // last: it ends before what it uses
};

}  // namespace vitreo
