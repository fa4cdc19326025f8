// Rotating controller: one turn of the loop for a robot in a rotating field as a plain calculation,
// position in, axis and frequency of the field out. No clock, no device.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/beat.h"
#include "control/command_history.h"
#include "control/estimator.h"
#include "control/servo_law.h"
#include "control/standstill.h"
#include "control/swim_law.h"
#include "host/rig/rig.h"
#include "host/servo/robot_clearance.h"
#include "host/servo/rotating_law.h"
#include "host/servo/servo_controller.h"

#include <Eigen/Core>

#include <deque>
#include <optional>

namespace vitreo {

struct RotatingControllerSettings {
  RotatingSettings law;
  double field = 2e-3;             // T
  Eigen::Vector3d axis{1, 0, 0};   // unit, world: of the rotation at first
  control::RotationLimits limits;  // of the coils; its update is told at each step
  double period = 1 / 15.0;        // s, between measurements
};

struct RotatingStep {
  std::optional<control::PositionEstimate> estimate;  // at `now`
  Eigen::Vector3d correction{0, 0, 0};  // m/s, asked for beyond the reference's own velocity
  control::FieldCurrents currents;      // A/T, where the robot is
  control::Currents constant;           // A, against the background
  bool limited = false;                 // the coils cut the field
  bool kept_out = false;                // the margin of a wall changed what is commanded
  bool outside = false;               // of the field model's region: its nearest position was used
  bool passed_over = false;           // the measurement
  double behind = 0;                  // s by which the reference has to wait for the robot
  std::optional<double> stepped_out;  // Hz, at which a step-out was found with this measurement
  bool recovered = false;             // the same: it turns with the field again
};

/// Law: u = (v_ref + sat(Kp (p_ref - p^)) - d) / (1 + g), as the law estimator's, less the velocity
/// at which the robot sinks; u's direction is that of the field's axis (control::swim), its
/// magnitude over the advance the rate. So gravity is made good by pitch.
class RotatingController {
 public:
  /// Throws std::invalid_argument naming the setting, or where robot and mode do not fit.
  RotatingController(const RigModel& model, const RotatingControllerSettings& settings);
  /// As ServoController::step. `update`: s between set-points, as the amplifier takes them. A mode
  /// other than follow and cancel lets the field stand still.
  RotatingStep step(double now, const std::optional<control::PositionMeasurement>& measured,
                    const ReferencePath& path, ControlMode mode, double update);
  /// Turns about `axis` (unit) at `frequency` (Hz; negative: the other way) from now on, wherever
  /// the robot goes; until steer(). Throws std::invalid_argument for what is no direction.
  void spin(const Eigen::Vector3d& axis, double frequency);
  void steer();
  bool spinning() const { return spin_.has_value(); }
  /// Of the walls whose margin a helix keeps, spun by hand or not; null: it may touch. Borrowed.
  void keep_out(const RobotClearance* clearance) { clearance_ = clearance; }
  const RotationState& state() const { return state_; }
  double advance() const { return advance_; }  // m/rad, as believed
  /// Forgets what was measured and commanded.
  void reset();

 private:
  struct Spin {
    Eigen::Vector3d axis;
    double frequency;
  };
  bool take(double now, const control::PositionMeasurement& measured, RotatingStep& step);
  void tune(double now, const control::PositionMeasurement& first);
  void watch(const control::PositionMeasurement& measured, RotatingStep& step);
  void settle_in(double more);
  void interrupt();
  void judge(bool found, RotatingStep& step);
  Eigen::Vector3d wanted(RotatingStep& step, double now, const ReferencePath& path,
                         ControlMode mode);
  void command(RotatingStep& step, double now, const Eigen::Vector3d& velocity, ControlMode mode);
  Eigen::Vector3d spun() const;
  double most() const;
  double usual_limit() const;
  bool too_slow(double speed, double frequency) const;
  bool oscillates() const { return settings_.law.mode == control::RotatingMode::oscillating; }
  Eigen::Vector3d steered(const Eigen::Vector3d& velocity);
  void allocate(RotatingStep& step, const Eigen::Vector3d& position, double update);
  Eigen::Vector3d sinking() const;
  void turn_phase(double now);
  std::optional<control::Beat::Moment> beating_at(double time) const;
  Eigen::Vector3d wall_normal(const Eigen::Vector3d& position) const;

  RigModel model_;
  RotatingControllerSettings settings_;
  double advance_;          // m/rad
  double lag_;              // s, of the robot's axis behind the field's
  double coils_limit_ = 0;  // Hz
  double step_out_limit_;   // Hz; infinite until there was one
  control::StepOutWatch watch_;
  control::Standstill still_;
  RotationState state_;
  std::optional<Spin> spin_;
  std::optional<control::ServoTuning> tuning_;
  std::optional<control::PositionEstimator> estimator_;
  std::optional<control::PositionEstimate> ahead_;  // when the command of this step acts
  const RobotClearance* clearance_ = nullptr;
  control::CommandHistory commands_;  // of the swimming alone
  control::Beat beat_;
  /// The field as it was commanded from `time` (s) on, with the phase that it had then.
  struct Turned {
    double time;
    double rate;  // rad/s
    control::Beat::Moment moment;
  };
  std::deque<Turned> turned_;  // of the last second
  std::optional<control::PositionMeasurement> last_;
  Eigen::Vector3d position_{0, 0, 0};  // m, the last known
  control::ServoChanges changes_;
  Eigen::Vector3d last_ahead_{0, 0, 0};      // m/s, commanded, behind the lag
  Eigen::Vector3d last_commanded_{0, 0, 0};  // m/s, of the swimming
  double turning_ = 0;                       // s for which the robot is not judged after a leap
  double began_ = 0;                         // s, of the first measurement
  int step_outs_ = 0;                        // since it last turned with the field
};

}  // namespace vitreo
