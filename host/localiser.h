// From pictures to a place: the tracked ellipse, the pose behind it, and what a second camera adds. No clock, no
// device.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/clock.h"
#include "host/rig.h"
#include "vision/background.h"
#include "vision/blob_tracker.h"
#include "vision/ellipse.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <optional>

namespace vitreo {

/// What one tick knows of the robot.
struct Sighting {
  std::optional<vision::EllipseMeasurement> ellipse;     // in the top camera's picture
  std::optional<Eigen::Vector3d> position;               // m, world; nothing when not seen or not localised
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  // m^2
  double residual_px = 0;                                // of the pose against the ellipse
};

/// What the side camera saw: x and z.
struct SideSighting {
  Time exposed{};
  Eigen::Vector2d place{0, 0};                           // m, world
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();  // m^2
};

/// One camera, through the optics of the eye (thesis 5).
class Localiser {
 public:
  /// `axis`: unit, world; taken for the robot's own.
  Localiser(const RigModel& model, vision::Background background, const Eigen::Vector3d& axis);
  Sighting look(const cv::Mat& image);

 private:
  void localise(Sighting& sighting);

  RigModel model_;
  Eigen::Vector3d axis_;
  vision::BlobTracker tracker_;
  optics::PoseSettings pose_;
  std::optional<Eigen::Vector3d> last_in_eye_;
};

/// Two orthogonal cameras: the place that fits both, each weighed by its covariance. The side camera knows the depth,
/// and what that says about x and y along the top camera's line of sight is in the covariance. A sighting without a
/// place stays so: one side view is not enough.
void join_side(Sighting& sighting, const SideSighting& side);

}  // namespace vitreo
