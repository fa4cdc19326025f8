// Record of the servo loop: its streams, and frames with ellipse, trail and target drawn on them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/pd.h"
#include "devices/roles/camera.h"
#include "host/record/recorder.h"
#include "host/rig/rig.h"
#include "host/servo/localizer.h"
#include "host/servo/robot_clearance.h"
#include "host/servo/servo_controller.h"

#include <Eigen/Core>

#include <cmath>
#include <deque>
#include <string>
#include <vector>

namespace vitreo {

/// Distance of a point from the retina, m, along its normal; negative beyond it.
double retina_distance(const RigModel& model, const Eigen::Vector3d& position);

class ServoRecord {
 public:
  /// `axis`: commanded orientation, world. `source` says what feeds the loop. `estimates`: with the
  /// stream "estimate".
  ServoRecord(Recorder& recorder, const Rig& rig, const Eigen::Vector3d& axis,
              const std::string& source, bool estimates);
  void sample(Time exposed, Time decided, Time now, const Observation& observation,
              const control::Reference& target, const ControlStep& step);
  /// The commanded orientation from the next row on.
  void set_axis(const Eigen::Vector3d& axis) { axis_ = axis.normalized(); }
  /// Of the robot's surface, with what it is believed by; not numbers while it is not known.
  void clearance(Time exposed, const std::optional<control::Clearance>& clearance,
                 const RobotClearance& surface, const ControlStep& step);
  /// The frame with the tracked ellipse, the trail and the target.
  void picture(const Frame& frame, const Observation& observation, const control::Reference& target,
               const std::string& caption);

 private:
  Recorder& recorder_;
  const Rig& rig_;
  Eigen::Vector3d axis_;
  // Numbers of the streams; -1: none.
  int samples_;
  int currents_;
  int clearances_;
  int commands_;
  int estimates_ = -1;
  Eigen::Vector3d position_ = Eigen::Vector3d::Constant(std::nan(""));  // m, last measured
  std::vector<double> row_;
  std::deque<Eigen::Vector2d> trail_;
};

}  // namespace vitreo
