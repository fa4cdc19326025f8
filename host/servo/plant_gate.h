// Plant gate: the positions to which the plant can have taken the robot since it was last believed,
// by which what an eye reports is admitted or refused.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <deque>
#include <optional>

namespace vitreo {

/// The last believed position moves on with the velocity that the currents give it by the model;
/// what the model does not know makes it less certain with time. World frame, SI.
class PlantGate {
 public:
  /// `unexplained`: m/s, standard deviation of the robot's velocity about the model's.
  explicit PlantGate(double unexplained) : unexplained_(unexplained) {}
  /// From `acts` (s) on the currents drive the robot at `velocity` (m/s).
  void driven(double acts, const Eigen::Vector3d& velocity);
  /// A position that steers, of the moment `time` (s), with its noise (m^2).
  void believed(double time, const Eigen::Vector3d& position, const Eigen::Matrix3d& noise);
  /// Squared Mahalanobis distance of a measured position from where the robot is expected at
  /// `time`; nothing where nothing has been believed for kMemory.
  std::optional<double> distance(double time, const Eigen::Vector3d& position,
                                 const Eigen::Matrix3d& noise) const;
  /// Within 5 standard deviations, or nothing is known.
  bool admits(double time, const Eigen::Vector3d& position, const Eigen::Matrix3d& noise) const;

 private:
  static constexpr double kMemory = 3;  // s: the robot may be anywhere afterwards
  struct Drive {
    double acts;
    Eigen::Vector3d velocity;
  };
  Eigen::Vector3d moved(double from, double until) const;

  const double unexplained_;
  std::deque<Drive> drives_;  // by `acts`
  std::optional<double> time_;
  Eigen::Vector3d position_{0, 0, 0};
  Eigen::Matrix3d noise_ = Eigen::Matrix3d::Zero();
};

}  // namespace vitreo
