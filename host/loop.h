// One turn of the servo loop as a plain calculation, frame in, currents out: what `make bench` measures, and what a
// replay of recorded frames can run again. No clock, no device.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/coil_field.h"
#include "control/pd.h"
#include "host/rig.h"
#include "vision/background.h"
#include "vision/blob_tracker.h"
#include "vision/ellipse.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <optional>

namespace vitreo {

struct LoopSettings {
  double field = 10e-3;           // T
  Eigen::Vector3d axis{1, 0, 0};  // unit, world: the commanded field's direction, taken as the robot's
  control::PdGains gains;
};

struct LoopStep {
  std::optional<vision::EllipseMeasurement> ellipse;
  std::optional<Eigen::Vector3d> position;               // m, world; nothing when not seen or not localised
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  // m^2
  double residual_px = 0;
  Eigen::Vector3d correction{0, 0, 0};  // m/s: what the controller asked for beyond the reference's own velocity
  control::Currents currents;           // A; empty when there is no position
  double force_scale = 1;               // below 1 where a current limit cut the force
};

class FrameToCurrents {
 public:
  FrameToCurrents(const RigModel& model, vision::Background background, const LoopSettings& settings,
                  double current_limit);
  /// `time` in s, of the exposure. `servo_position`: false leaves the place alone (levitation and field only).
  LoopStep step(const cv::Mat& image, double time, const control::Reference& reference, bool servo_position);
  /// The field without any force, at the workspace's centre: turns a robot that is not yet seen into its axis.
  control::Currents orienting_currents() const;
  void set_trim(const Eigen::Vector3d& force) { trim_ = force; }  // N, world
  Eigen::Vector3d trim() const { return trim_; }
  /// The force that moves the robot at `velocity`, N.
  Eigen::Vector3d force_of(const Eigen::Vector3d& velocity) const { return drag_ * velocity; }

 private:
  void localise(LoopStep& step);
  void allocate(LoopStep& step, const Eigen::Vector3d& velocity);

  RigModel model_;
  LoopSettings settings_;
  double current_limit_;
  vision::BlobTracker tracker_;
  optics::PoseSettings pose_;
  control::PdController controller_;
  Eigen::Matrix3d drag_;
  Eigen::Vector3d trim_{0, 0, 0};
  std::optional<Eigen::Vector3d> last_in_eye_;
};

}  // namespace vitreo
