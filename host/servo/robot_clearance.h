// Robot clearance: how near the robot's surface is to retina and lens, by what a servo loop
// believes of its shape, its attitude and its view; and whether a path keeps the margin.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/clearance.h"
#include "control/keep_out.h"
#include "control/trajectory.h"
#include "host/rig/rig.h"
#include "optics/analysis/depth_doubt.h"

#include <Eigen/Core>

#include <limits>
#include <optional>
#include <string>

namespace vitreo {

/// Attitude and view of a loop; as it is before there is one: any attitude, the rig's own view.
struct ClearanceBelief {
  Eigen::Vector3d axis{1, 0, 0};                                // unit, world
  double axis_sigma = std::numeric_limits<double>::infinity();  // rad
  bool through_eye = true;                                      // positions come by the top camera
  bool calibrated = false;             // on the retina (ServoSettings::view)
  Eigen::Vector3d looked_at{0, 0, 0};  // m, eye frame: where the robot lay then
};

class RobotClearance {
 public:
  /// Throws std::invalid_argument naming a setting.
  RobotClearance(const RigModel& model, const ClearanceBelief& belief);
  /// At a position (m, world) with the covariance of its measurement (m^2); what is doubtful of the
  /// view comes on top. Nothing for a rig whose eye has no lens: it has no walls to know of.
  std::optional<control::Clearance> at(
      const Eigen::Vector3d& position,
      const Eigen::Matrix3d& covariance = Eigen::Matrix3d::Zero()) const;
  /// m^2, what the position may be off by the robot's attitude, from now on: it stays while the
  /// robot does not turn, so that it is no part of a filter's covariance, and is not known before a
  /// measurement.
  void doubt_by_attitude(const Eigen::Matrix3d& covariance) { by_attitude_ = covariance; }
  /// The robot's axis from now on, unit, world, and how well it is known (rad).
  void expect_axis(const Eigen::Vector3d& axis, double sigma) {
    belief_.axis = axis;
    belief_.axis_sigma = sigma;
  }
  double margin() const { return model_.margin; }  // m
  const ClearanceBelief& belief() const { return belief_; }
  /// Throws std::invalid_argument with the clearance and the margin in mm where the path's end, or
  /// any place of it, is nearer than the margin. A path that begins nearer may lead away.
  void check(const control::Trajectory& path) const;
  /// A wall was felt where `distance` (m) was still believed: from now on every distance to it is
  /// less by that.
  void felt(bool lens, double distance);

 private:
  double by_other_place(const Eigen::Vector3d& in_eye) const;
  struct Walls {
    double margin = 0;
    bool there = false;
    Eigen::Vector3d eye_in_world{0, 0, 0};
    control::BodySurface body;
    control::EyeCavity eye;
  };
  Walls model_;
  ClearanceBelief belief_;
  optics::DepthDoubt doubt_;
  Eigen::Matrix3d by_attitude_ = Eigen::Matrix3d::Zero();  // m^2
  double eye_sigma_ = 0;     // m, of where the eye stands, each coordinate
  double felt_retina_ = 0;   // m
  double felt_lens_ = 0;     // m
  bool look_helps_ = false;  // at the robot on the retina: it was not seen there yet
};

/// Clearances, and the place (m, world) that each wall's is of.
struct PlacedClearance {
  control::Clearance walls;
  Eigen::Vector3d near_retina{0, 0, 0};
  Eigen::Vector3d near_lens{0, 0, 0};
  const Eigen::Vector3d& nearest_place() const { return walls.at_lens() ? near_lens : near_retina; }
};
PlacedClearance placed_at(const Eigen::Vector3d& position, const control::Clearance& walls);
/// Of two places where the robot may be: of each wall the one whose bound is nearer.
PlacedClearance nearer_of(const PlacedClearance& one, const PlacedClearance& other);

/// "0.35 mm from the retina (±0.23 mm)", or "0.12 mm inside the lens".
std::string clearance_text(const control::Clearance& clearance);

}  // namespace vitreo
