// Scene of a run in three dimensions: eye, retina and lens as the rig's model has them, robot and
// target as a row of the record has them, in messages of Foxglove's schemas.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/channels/foxglove_schema.h"

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <nlohmann/json.hpp>

#include <optional>
#include <string>

namespace vitreo {

/// What is drawn of the robot and its target at one moment; m, world.
struct SceneRow {
  std::optional<Eigen::Vector3d> robot;
  std::optional<Eigen::Vector3d> axis;   // along the robot, of any length; none: not recorded
  std::optional<Eigen::Vector3d> sigma;  // standard deviations of the position
  std::optional<Eigen::Vector3d> target;
};

class RunScene {
 public:
  /// `geometry`: RunStart::rig["geometry"] (host/rig/geometry.h); null: of a record that has none,
  /// where the eye is not drawn and the robot is a point.
  RunScene(const nlohmann::json& geometry, UtcClock clock);

  /// foxglove.SceneUpdate of what stands still: eye, retina, lens. Nothing without a geometry.
  std::optional<nlohmann::json> eye(Time time) const;
  /// foxglove.SceneUpdate of robot and target; what is not there is deleted from the scene.
  nlohmann::json row(Time time, const SceneRow& row) const;
  /// foxglove.FrameTransforms: the eye and the cameras in the world. A camera's frame is at the
  /// lens (top) or the world's origin (side), z in the direction of view, x to the right, y down.
  nlohmann::json transforms(Time time) const;

 private:
  double number(const char* name, double otherwise) const;
  nlohmann::json entity(Time time, const std::string& id) const;
  nlohmann::json robot(Time time, const SceneRow& row) const;

  const nlohmann::json geometry_;
  const UtcClock clock_;
};

/// foxglove.Color; each from 0 to 1, `alpha` 1: opaque.
nlohmann::json color_json(double red, double green, double blue, double alpha);
/// {"position", "orientation"}, foxglove.Pose.
nlohmann::json pose_json(const Eigen::Vector3d& position, const Eigen::Quaterniond& orientation);
/// The rotation that takes +x, along which Foxglove draws poses and arrows, to `axis`.
Eigen::Quaterniond along(const Eigen::Vector3d& axis);

}  // namespace vitreo
