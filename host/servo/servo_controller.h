// One turn of the servo loop as a plain calculation, place in, currents out: estimate, law, field
// and force, currents. What `make bench` measures and a replay can run again. No clock, no device.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/box_allocation.h"
#include "control/estimator.h"
#include "control/pd.h"
#include "control/servo_law.h"
#include "control/trajectory.h"
#include "control/velocity_control.h"
#include "host/rig/rig.h"

#include <Eigen/Core>

#include <optional>
#include <string>

namespace vitreo {

/// pd: the thesis' (6). estimator: Kalman filter, prediction over the loop's latency, disturbance
/// canceled. velocity: for media that yield and spring back (7.3).
enum class ControlLaw { pd, estimator, velocity };
const char* to_string(ControlLaw law);
/// Throws std::invalid_argument with the names there are.
ControlLaw control_law_named(const std::string& name);

/// What is done about the robot's place: go where the course says; only cancel what pushes it
/// (estimator only); leave it, the field computed where it is; or the one set of currents of the
/// place where the trim was found.
enum class Aim { follow, cancel, leave, constant };

/// A trajectory and when it begins.
struct ReferencePath {
  control::Trajectory path = control::Trajectory::hold_at(Eigen::Vector3d::Zero());
  double begin = 0;  // s
  control::Reference at(double time) const { return path.at(time - begin); }
};

struct ControllerSettings {
  double field = 10e-3;  // T
  Eigen::Vector3d axis{1, 0,
                       0};  // unit, world: the commanded field's direction, taken as the robot's
  ControlLaw law = ControlLaw::pd;
  control::PdGains gains;  // of pd
  // Of estimator, 1/s and m/s; nothing: tuned from latency, drag and instability.
  std::optional<double> proportional{}, max_speed{};
  control::VelocityGains velocity;                                          // of velocity
  control::CurrentLimits limits = control::CurrentLimits::Constant(8, 12);  // A; 0 for a dead coil
  double total_limit = 60;                                                  // A, sum of magnitudes
  double period = 1 / 15.0;  // s, between measurements
  bool wall_drag = false;  // Faxen's factors for retina and lens, where the robot is; else the free
                           // drag everywhere
};

struct ControlStep {
  control::Currents currents;                         // A; empty when nothing is known of the place
  std::optional<control::PositionEstimate> estimate;  // at `now`; law estimator only
  Eigen::Vector3d correction{
      0, 0, 0};          // m/s: what was asked for beyond the reference's own velocity and the trim
  double headroom = 1;   // 1 - the largest |I| / limit over the living coils
  bool limited = false;  // a limit cost something of field or force
  bool outside = false;  // of the field model's region: its nearest place was used
  bool passed_over = false;  // the measurement: not a number, out of order or beyond the gate
};

class ServoController {
 public:
  /// Throws std::invalid_argument naming the setting.
  ServoController(const RigModel& model, const ControllerSettings& settings);
  /// Times in s; `now` is when the currents are set. Nothing measured: the estimator goes on by
  /// prediction, the other laws give nothing. Throws std::domain_error when the levitation is out
  /// of reach.
  ControlStep step(double now, const std::optional<control::PositionMeasurement>& measured,
                   const ReferencePath& course, Aim aim);
  /// Forgets what was measured and commanded: the currents were not sent.
  void reset();
  /// The field without any force, at the workspace's center: turns a robot that is not yet seen
  /// into its axis.
  control::Currents orienting_currents() const;
  /// The constant force added to the weight compensation, N, world, and where it was found.
  void set_trim(const Eigen::Vector3d& force, const Eigen::Vector3d& place);
  Eigen::Vector3d trim() const { return trim_; }
  /// The force that moves the robot at `velocity`, N.
  Eigen::Vector3d force_of(const Eigen::Vector3d& velocity) const { return drag_ * velocity; }
  /// N s/m at a place (m, world): free, or with what the walls add.
  Eigen::Matrix3d drag_at(const Eigen::Vector3d& place) const;
  /// As tuned; nothing before the first measurement, and for other laws.
  const std::optional<control::ServoTuning>& tuning() const { return tuning_; }

 private:
  void tune(double now, const control::PositionMeasurement& first);
  bool take(double now, const control::PositionMeasurement& measured);
  void predict(ControlStep& step, double now, const ReferencePath& course, Aim aim);
  void steer(ControlStep& step, const control::PositionMeasurement& measured,
             const ReferencePath& course, Aim aim);
  Eigen::Vector3d allocate(ControlStep& step, const Eigen::Vector3d& place,
                           const Eigen::Vector3d& force) const;
  control::BoxAllocation within(const control::FieldMatrix& matrix,
                                const control::FieldGradient& background,
                                const Eigen::Vector3d& force) const;

  RigModel model_;
  ControllerSettings settings_;
  Eigen::Matrix3d drag_, mobility_;  // N s/m, and its inverse
  Eigen::Vector3d trim_{0, 0, 0}, trim_place_{0, 0, 0};
  control::PdController pd_;
  control::VelocityController velocity_;
  std::optional<control::ServoTuning> tuning_;
  std::optional<control::PositionEstimator> estimator_;
  double last_measured_ = -1e9;  // s
};

}  // namespace vitreo
