// Believed view of the robot: the ellipse that the top camera would show of it, by the rig's own
// optics. A dry run, which has poses in place of images, has its ellipses from here.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/camera.h"
#include "host/rig/rig.h"
#include "optics/pose/body_pose.h"
#include "optics/pose/pose_settings.h"
#include "vision/ellipse.h"

#include <Eigen/Core>

#include <optional>

namespace vitreo {

/// How the rig's robot is seen through its optics: what pose estimation inverts (thesis 5.3).
optics::PoseSettings pose_settings_of(const RigModel& model);

/// The same with `object` in the spheroid's place.
optics::ObjectPoseSettings object_settings_of(const RigModel& model,
                                              const optics::ObjectModel& object);

class BelievedView {
 public:
  /// `axis`: of the robot, unit, world. Throws std::invalid_argument naming it.
  BelievedView(const RigModel& model, const CameraInfo& camera, const Eigen::Vector3d& axis);
  /// Of a robot at `position` (m, world); its covariance is that of a good outline, a tenth of a
  /// pixel. Nothing where the optics do not show it, or with its center outside of the image.
  std::optional<vision::EllipseMeasurement> ellipse_at(const Eigen::Vector3d& position) const;

 private:
  std::optional<vision::Ellipse> through_eye(const Eigen::Vector3d& position) const;
  vision::Ellipse from_above(const Eigen::Vector3d& position) const;

  optics::PoseSettings pose_;
  std::optional<optics::ObjectPoseSettings> flat_ended_;  // a cylinder's or a disc's own outline
  Eigen::Vector3d eye_in_world_;
  bool plain_view_;
  Eigen::Vector2d size_px_;
  Eigen::Vector3d axis_;
};

}  // namespace vitreo
