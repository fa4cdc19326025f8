// Servo controller: one turn of the loop as a plain calculation, position in, currents out:
// estimate, law, field and force, currents. No clock, no device: `make bench` measures it as it is.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/estimator.h"
#include "control/innovation_statistics.h"
#include "control/loop_margins.h"
#include "control/pd.h"
#include "control/servo_law.h"
#include "control/standstill.h"
#include "control/velocity_control.h"
#include "host/rig/rig.h"
#include "host/servo/controller_settings.h"
#include "host/servo/field_allocator.h"
#include "host/servo/loop_watch.h"

#include <Eigen/Core>

#include <optional>
#include <string>
#include <utility>

namespace vitreo {
class RobotClearance;

struct ControlStep {
  control::Currents currents;                         // A; empty when the position is not known
  std::optional<control::PositionEstimate> estimate;  // at `now`; law estimator only
  // m/s: what was asked for beyond the reference's own velocity and the trim.
  Eigen::Vector3d correction{0, 0, 0};
  double field = 0;          // T, for which the currents are
  double headroom = 1;       // 1 - the largest |I| / limit over the living coils
  bool limited = false;      // a limit cost something of field or force
  bool kept_out = false;     // the keep-out margin changed the velocity
  bool outside = false;      // of the field model's region: its nearest position was used
  bool passed_over = false;  // the measurement: not a number, out of order or beyond the gate
  // The filter: gain or delay met its bound; its innovations have long been larger than it says.
  bool at_bound = false;
  bool inconsistent = false;
  // Law velocity: its force has changed by what moves a robot in any gel, and this one is seen in
  // one place.
  bool standing = false;
  // m/s, law estimator: the believed velocity of the currents, after the limits, beyond levitation.
  Eigen::Vector3d commanded{0, 0, 0};
  LoopQuality quality;
};

/// How far the law estimator's loop is from oscillating, with the gains of its last step, and what
/// its filter knows.
struct ServoMargins {
  control::LoopMargins margins;     // of the believed loop, with what was estimated of it
  control::ServoSchedule schedule;  // gain and bandwidth in use
  control::PositionEstimate estimate;
  double innovation = 0;   // InnovationStatistics::normalized, of the last seconds
  double correlation = 0;  // InnovationStatistics::correlation
};

class ServoController {
 public:
  /// Throws std::invalid_argument naming the setting.
  ServoController(const RigModel& model, const ControllerSettings& settings);
  ServoController(const ServoController&) = delete;
  ServoController& operator=(const ServoController&) = delete;
  /// Times in s; `now` is when the currents are set. Nothing measured: the estimator goes on by
  /// prediction, the other laws give nothing. Throws std::domain_error where none can levitate it.
  ControlStep step(double now, const std::optional<control::PositionMeasurement>& measured,
                   const ReferencePath& path, ControlMode mode);
  void set_axis(const Eigen::Vector3d& axis);  ///< of the field from the next step on
  /// No command brings the robot nearer to a wall than the margin, whatever the law; null: it may.
  void keep_out(const RobotClearance* borrowed) { clearance_ = borrowed; }
  /// The robot may touch what is there: its watch does not take that for a coil's lack.
  void may_touch(bool allowed) { watch_.may_touch(allowed); }
  /// Measurements from now on lie aside by that, m: the view was corrected, the robot has not
  /// moved.
  void view_moved(const Eigen::Vector3d& by);
  /// Forgets what was measured and commanded: the currents were not sent.
  void reset();
  /// The field without force at the center: turns a robot that is not yet seen into its axis.
  control::Currents orienting_currents() const { return allocator_.orienting(); }
  /// The constant force added to the weight compensation, N, world, and where it was found.
  void set_trim(const Eigen::Vector3d& force, const Eigen::Vector3d& position);
  Eigen::Vector3d trim() const { return trim_; }
  /// The force that moves the robot at `velocity`, N.
  Eigen::Vector3d force_of(const Eigen::Vector3d& velocity) const { return drag_ * velocity; }
  /// N s/m at a position (m, world): free, or with what the walls add.
  Eigen::Matrix3d drag_at(const Eigen::Vector3d& position) const;
  /// As tuned; nothing before the first measurement, and for other laws.
  const std::optional<control::ServoTuning>& tuning() const { return tuning_; }
  /// Nothing before the second step that took a measurement, and for other laws. A few
  /// milliseconds.
  std::optional<ServoMargins> margins() const;
  /// T: with which no limit would have cut what was asked for last (FieldAllocator::stronger).
  std::optional<double> stronger_field() const {
    return allocator_.stronger(asked_.position, asked_.force);
  }
  /// Its filter; null before the first measurement, and for other laws.
  const control::PositionEstimator* estimator() const;

 private:
  static constexpr double kInnovationMemory = 10;  // s
  static constexpr double kToldInGel = 0.1e-3;     // m, by which a force would move it
  void watch(const control::PositionMeasurement& measured, const ReferencePath& path,
             ControlMode mode);
  void watch_command(const ControlStep& step, double now, const Eigen::Matrix3d& mobility,
                     bool capped);
  void let_go(ControlStep& step, double now, const Eigen::Vector3d& position);
  void tune(double now, const control::PositionMeasurement& first);
  bool take(double now, const control::PositionMeasurement& measured);
  void predict(ControlStep& step, double now, const ReferencePath& path, ControlMode mode);
  void steer(ControlStep& step, double now, const control::PositionMeasurement& measured,
             const ReferencePath& path, ControlMode mode);
  void plan(const control::PositionEstimate& ahead, double reference_speed);
  bool stands(const control::PositionMeasurement& measured, const Eigen::Vector3d& force);
  Eigen::Vector3d allocate(ControlStep& step, const Eigen::Vector3d& position,
                           const Eigen::Vector3d& force);

  RigModel model_;
  ControllerSettings settings_;
  Eigen::Matrix3d drag_;      // N s/m, free
  Eigen::Matrix3d mobility_;  // its inverse
  FieldAllocator allocator_;  // of model_
  Eigen::Vector3d trim_{0, 0, 0};
  Eigen::Vector3d trim_position_{0, 0, 0};
  control::PdController pd_;
  control::VelocityController velocity_;
  control::Standstill still_{kToldInGel};  // of the law velocity
  Eigen::Vector3d pushed_{0, 0, 0};        // N, by it in the last step
  const RobotClearance* clearance_ = nullptr;
  std::optional<control::ServoTuning> tuning_;
  std::optional<control::PositionEstimator> estimator_;
  control::InnovationStatistics innovations_{kInnovationMemory};
  control::PositionEstimate ahead_;  // of the last step, when its command acts
  control::ServoSchedule schedule_;  // of the last step
  control::ServoChanges changes_;
  Eigen::Vector3d last_commanded_{0, 0, 0};  // m/s behind the lag, at the last step
  struct {
    Eigen::Vector3d position{0, 0, 0};  // m
    Eigen::Vector3d force{0, 0, 0};     // N
  } asked_;                             // of the last allocation
  LoopWatch watch_;
  std::optional<std::pair<double, Eigen::Vector3d>> watched_;  // s; axis then
  double last_measured_ = -1e9;                                // s
  double estimated_ = -1e9;  // s, of the last measurement that the filter used
};

}  // namespace vitreo
