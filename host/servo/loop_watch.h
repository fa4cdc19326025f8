// Loop watch: the quality of a servo loop's control while it runs: oscillation, standstill, caps,
// and a coil that carries less than it is given.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/coil_watch.h"
#include "control/command_history.h"
#include "control/motion_watch.h"
#include "host/rig/rig.h"

#include <Eigen/Core>

#include <deque>
#include <optional>
#include <utility>
#include <vector>

namespace vitreo {

/// What is wrong with the control, at one moment. All false: nothing is.
struct LoopQuality {
  bool oscillating = false;  // a limit cycle, or a loop at its margin
  double period = 0;         // s, of it
  double amplitude = 0;      // m
  bool standing = false;     // told to move, and does not
  bool off_target = false;   // long far from its target, and comes no nearer
  double rests_off = 0;      // m, from a target that rests: what the law leaves standing
  bool kept_out = false;     // the keep-out margin has long changed the command
  bool capped = false;       // the feedback has long asked for its largest speed
  bool clamped = false;      // the disturbance has long been at its largest: the robot is held fast
  int weak_coil = 0;         // from 1: which carries less than it is given; 0: none
  double lack = 0;           // part of its current that is missing
  bool good() const {
    return !oscillating && !standing && !off_target && rests_off == 0 && !kept_out && !capped &&
           !clamped && weak_coil == 0;
  }
};

/// What one turn of a loop decided.
struct WatchedCommand {
  double now = 0;  // s
  control::Currents currents;
  Eigen::Vector3d position{0, 0, 0};                       // m, for which they are
  Eigen::Matrix3d mobility = Eigen::Matrix3d::Identity();  // m/(N s), there
  bool capped = false;
  bool clamped = false;
};

class LoopWatch {
 public:
  /// The model is borrowed.
  explicit LoopWatch(const RigModel& model);
  /// Of any law: position and target, once a measurement.
  void moved(const control::WatchedMotion& motion) {
    if (motion.time >= followed_from_) motion_.add(motion);
  }
  /// Of any law: whether the keep-out margin changed the command at `now` (s).
  void kept_out(double now, bool is);
  /// Of the law estimator: what was commanded.
  void commanded(const WatchedCommand& command);
  /// A measurement at `time` (s) that its filter used, before the command that it leads to.
  /// `restarted`: the filter began anew with it. The delay is that of the loop as it is known now.
  void measured(double time, const control::PositionEstimator& filter, double delay,
                bool restarted);
  LoopQuality quality() const;
  /// Positions from now on lie aside: no motion of the robot.
  void view_moved() { motion_.reset(); }
  /// The robot is left alone, or falls on purpose, at `now` (s): what it did until now is no answer
  /// to a target, and after a fall it is none, and says nothing of single coils, until it is
  /// caught.
  void let_alone(double now, bool falls);
  /// Whether the robot may touch something: what that takes of its motion is no coil's lack.
  void may_touch(bool allowed) { may_touch_ = allowed; }
  void reset();

 private:
  void suspect(double time);
  /// m/s, of each coil in a history's order: the motion that it makes, linear and curved
  /// (control::CoilMotions), and by turns of its field.
  static constexpr int kHistories = 5;
  using Velocities =
      Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, kHistories * control::kMaxCoils>;
  Velocities velocities(const WatchedCommand& command) const;

  const RigModel& model_;
  control::MotionWatch motion_;
  control::CoilWatch coils_;
  // m/s: of each coil's current, then curved, then m/s/rad of turns about x, about y, about z
  std::vector<control::CommandHistory> given_;
  std::vector<Eigen::Vector3d> flowing_;          // m/s, behind the lag
  std::deque<std::pair<double, double>> delays_;  // s: time, and the delay as it was estimated then
  std::optional<double> last_;                    // s, of the measurement before
  double heard_from_ = 0;                         // s, before which coils are not judged
  bool may_touch_ = false;
  double followed_from_ = -1e9;  // s, before which motion is not
  double capped_since_ = -1;     // s; below 0: not
  double kept_out_since_ = -1;
  double clamped_since_ = -1;
  double now_ = 0;
  int suspected_ = 0;
  double suspected_since_ = 0;
  int named_ = 0;
  double lack_ = 0;
  double cleared_ = 0;  // s, when the named coil was last suspect
};

}  // namespace vitreo
