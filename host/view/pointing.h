// Pointing: from pixels of the live view to positions in the world, and the geometry that the page
// draws.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/rig/rig.h"
#include "host/servo/robot_clearance.h"

#include <Eigen/Core>
#include <nlohmann/json.hpp>

#include <vector>

namespace vitreo::view {

class Pointing {
 public:
  explicit Pointing(const RigModel& model) : model_(model) {}

  /// Geometry for the page's drawing: {"side_pixel", "side_center", "top_px_per_m", "retina": {"z",
  /// "radius"}, "lens_z"}; m and px.
  nlohmann::json to_json() const;

  /// The positions, m, world, that a message of the page means; each is within reach
  /// (host/servo/servo.h's check_reach), and leaves the keep-out margin by what the loop believes.
  ///   {"camera": "top_camera", "points": [[u, v], ...], "z": m}: on these pixels, at that height
  ///   {"camera": "side_camera", "points": [[u, v], ...], "y": m}: x and z from the pixels
  ///   {"place": [x, y, z]}
  /// Throws std::invalid_argument saying what is wrong.
  std::vector<Eigen::Vector3d> positions(const nlohmann::json& message,
                                         const ClearanceBelief& belief = {}) const;
  /// Positions under the points of a message {"camera": "top_camera", "points", "z": m}, for rulers
  /// and cursors: [x, y, z] in m, or null where nothing of that height shows. Nothing is checked
  /// against the reach. Throws std::invalid_argument for more than 100 points.
  nlohmann::json where(const nlohmann::json& message) const;
  /// Of the loop that wrote the stream clearance; without a row any attitude, and the rig's own
  /// view.
  static ClearanceBelief belief(const std::vector<double>& clearance);

  /// The world's (x, y) at height z that shows at a pixel of the top camera: the projection,
  /// inverted by Newton's method to 1 nm. Throws std::invalid_argument where nothing of that height
  /// shows there.
  Eigen::Vector3d at_height(const Eigen::Vector2d& pixel, double z) const;

  /// Image of the target in the top camera, px: {"target_px"}, or nothing, from the last row of the
  /// stream servo.
  nlohmann::json marks(const std::vector<double>& servo) const;

  /// The commanded field at the robot, {"tesla", "direction": [x, y, z]}, from the last row of the
  /// stream command; null where there is no robot.
  static nlohmann::json field(const std::vector<double>& command);

 private:
  std::optional<Eigen::Vector2d> pixel_of(const Eigen::Vector3d& position) const;
  const RigModel model_;
};

}  // namespace vitreo::view
